"""Training data of behaviour cloning, read from demonstrations."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dexgrasp.data.demonstrations.generate import read_about
from dexgrasp.data.demonstrations.hdf5_formats import read_episodes
from dexgrasp.data.demonstrations.rollout import Demonstration, intended
from dexgrasp.data.demonstrations.settings import MODES
from dexgrasp.learning.imitation.cloud_features import ObservedCloud, grip_features, observed_cloud
from dexgrasp.learning.imitation.demonstrated_grasp import demonstrated_grasp, grasp_to_row
from dexgrasp.learning.imitation.settings import BcSettings
from dexgrasp_env.arrays import Array, Index, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import content_hash
from dexgrasp_env.robot.cell import Cell, make_cell
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.tasks.features import entry, features, initial_scene

GripBatch = tuple[Single, Single, Single]
"""Points (E, m, N, 6) and features (E, m, F) of E objects along m grips, and rows (E, R) of the grasps taken.

The first grip of each object is the one that was taken.
"""


class StepBatch(NamedTuple):
    """Control steps of some episodes: features (E, R, F), and the next set-points (E, R, chunk, n) rad."""

    features: Single
    chunks: Single


@dataclass(frozen=True)
class ControlSteps:
    """Control steps of demonstrations, concatenated.

    Attributes:
        features: (S, F) inputs of the network.
        targets: (S, n) rad, set-points before each step.
        intended: (S, n) rad, set-points that the demonstrator intended after it, without noise.
        first: (E,) index of the first step of each episode.
        steps: (E,) lengths of the episodes.
        control_mode: of the demonstrations.
        key: hash of the arrays.
    """

    features: Single
    targets: Single
    intended: Single
    first: Index
    steps: Index
    control_mode: str
    key: str

    def __len__(self) -> int:
        return len(self.steps)

    def batch(self, episodes: Index, rows: Index, length: int) -> StepBatch:
        """Return steps (E, R) of episodes (E,), each with the next `length` set-points relative to the present ones."""
        # Beyond the end they stand still.
        ahead = np.minimum(rows[..., None] + np.arange(length), self.steps[episodes][:, None, None] - 1)
        first = self.first[episodes][:, None]
        now = first + rows
        return StepBatch(
            self.features[now], self.intended[first[..., None] + ahead] - self.targets[now][:, :, None]
        )

    def draw(self, rng: np.random.Generator, among: Index, settings: BcSettings) -> StepBatch:
        """Draw a batch; long episodes come as often as short ones."""
        chosen = rng.choice(among, settings.episodes, replace=len(among) < settings.episodes)
        at = (rng.random((settings.episodes, settings.rows)) * self.steps[chosen][:, None]).astype(int)
        return self.batch(chosen, at, settings.network.chunk)

    def tested(self, among: Index, settings: BcSettings) -> StepBatch:
        """Return 16 evenly spaced steps of each of some episodes."""
        at = (np.linspace(0.0, 1.0, 16, endpoint=False) * self.steps[among][:, None]).astype(int)
        return self.batch(among, at, settings.network.chunk)


def read_steps(folders: Sequence[Path]) -> ControlSteps:
    """Read demonstrations.

    Args:
        folders: of `dexgrasp demos generate`.

    Raises:
        InputError: for folders without demonstrations, of different modes, or without the state.
    """
    robot = demonstrated_cell(folders).robot
    parts = [
        _parts(episode, noise, robot) for episode, noise in _shown(folders, "observations", "object_pose")
    ]
    steps = np.array([len(inputs) for inputs, _, _ in parts])
    inputs, targets, aims = map(np.concatenate, zip(*parts, strict=True))
    arrays = (inputs, targets, aims, np.cumsum(steps) - steps, steps)
    mode = str(read_about(folders[0])["settings"]["control_mode"])
    return ControlSteps(*arrays, control_mode=mode, key=content_hash(*arrays))


def _parts(episode: Demonstration, noise: float, robot: Robot) -> tuple[Single, ...]:
    seen = episode.observations
    scene = initial_scene({key: array[0] for key, array in seen.items()})
    inputs = features(scene, {key: array[:-1] for key, array in seen.items()}, np.arange(len(episode)))
    ways = entry(seen, "joint_targets")[:-1], intended(episode, noise, robot)[1:]
    return tuple(part.astype(np.float32) for part in (inputs, *ways))


@dataclass(frozen=True)
class Grips:
    """Observed objects, and the grasps that demonstrations took.

    Attributes:
        clouds: E observed clouds.
        azimuths: (E,) rad, of the grips.
        rows: (E, R) of the grasps, see `grasp_to_row`.
        key: hash of the arrays.
    """

    clouds: tuple[ObservedCloud, ...]
    azimuths: Array
    rows: Single
    key: str

    def __len__(self) -> int:
        return len(self.clouds)

    def draw(self, rng: np.random.Generator, among: Index, settings: BcSettings) -> GripBatch:
        """Draw a batch, with new points of each cloud."""
        size = settings.episodes
        return self._batch(rng, rng.choice(among, size, replace=len(among) < size), settings.grips)

    def tested(self, among: Index, settings: BcSettings) -> GripBatch:
        """Return a fixed batch of some episodes."""
        return self._batch(np.random.default_rng(0), among, settings.grips)

    def _batch(self, rng: np.random.Generator, episodes: Index, grips: int) -> GripBatch:
        others = (np.arange(1, grips) + rng.uniform(-0.4, 0.4, (len(episodes), 1))) * (2 * np.pi / grips)
        azimuths = self.azimuths[episodes][:, None] + np.pad(others, ((0, 0), (1, 0)))
        seen = [
            grip_features(self.clouds[i], turns, rng) for i, turns in zip(episodes, azimuths, strict=True)
        ]
        points, numbers = zip(*seen, strict=True)
        return np.stack(points), np.stack(numbers), self.rows[episodes]


def read_grips(folders: Sequence[Path]) -> Grips:
    """Read clouds and grasps of demonstrations in which the hand closed once, while the arm stood still.

    Args:
        folders: of `dexgrasp demos generate`.

    Raises:
        InputError: for folders without such demonstrations, of different modes, or without clouds.
    """
    clouds, grasps, cell = [], [], demonstrated_cell(folders)
    for episode, noise in _shown(folders, "once", "cloud"):
        if grasp := demonstrated_grasp(episode, noise, cell):
            clouds.append(observed_cloud(episode.once))
            grasps.append(grasp)
    if not grasps:
        raise InputError("in no demonstration the arm waits once for the hand to close: clone from the state")
    pairs = zip(grasps, clouds, strict=True)
    rows = np.stack([grasp_to_row(grasp, cloud.middle) for grasp, cloud in pairs]).astype(np.float32)
    azimuths = np.array([grasp.azimuth for grasp in grasps])
    return Grips(
        tuple(clouds), azimuths, rows, content_hash(np.stack([cloud.seen for cloud in clouds]), rows)
    )


def demonstrated_cell(folders: Sequence[Path]) -> Cell:
    """Return the cell of some folders of demonstrations.

    Raises:
        InputError: for folders of different robots or modes.
    """
    first, *others = (read_about(folder)["settings"] for folder in folders)
    cell = make_cell(first.get("robot"))
    for folder, settings in zip(folders[1:], others, strict=True):
        if (other := make_cell(settings.get("robot")).robot.stamp) != cell.robot.stamp:
            raise InputError(
                f"{folder} is of the robot {other}, {folders[0]} of {cell.robot.stamp}: valid is one"
            )
        if any(settings[key] != first[key] for key in MODES):
            raise InputError(
                f"{folder} and {folders[0]} differ in {' or '.join(MODES)}: demonstrations of one kind are wanted"
            )
    return cell


def _shown(folders: Sequence[Path], part: str, key: str) -> Iterator[tuple[Demonstration, float]]:
    """Yield demonstrations, and the noise that they were recorded with.

    Raises:
        InputError: if one lacks `key` in `part`, which is `observations` or `once`.
    """
    for folder in folders:
        noise = float(read_about(folder)["settings"]["noise"])
        for episode in read_episodes(folder):
            if key not in getattr(episode, part):
                raise InputError(f"{folder} has no {key}: a policy that sees it cannot be cloned from it")
            yield episode, noise
