"""Demonstrations as a network is trained on them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dexgrasp.demos.generate import read_about
from dexgrasp.demos.minari_format import read_episodes
from dexgrasp.demos.rollout import Episode, intended
from dexgrasp.imitation.features import POINTS, features, first_look
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import content_hash
from dexgrasp_env.robot.cell import default_cell

Floats = NDArray[np.float32]


class Batch(NamedTuple):
    """Rows of some episodes: features (E, R, F), clouds (E, N, 3), set-points to come (E, R, chunk, 23) rad."""

    looks: Floats
    points: Floats
    chunks: Floats


@dataclass(frozen=True)
class Rows:
    """Control steps of many demonstrations, one after the other.

    Attributes:
        looks: (S, F) features.
        targets: (S, 23) rad, set-points before each step.
        meant: (S, 23) rad, what the demonstrator meant them to be after it, without its noise.
        first: (E,) rows that the episodes begin at.
        steps: (E,) lengths.
        points: (E, N, 3) of the clouds.
        key: hash of all that.
    """

    looks: Floats
    targets: Floats
    meant: Floats
    first: NDArray[np.int64]
    steps: NDArray[np.int64]
    points: Floats
    key: str

    def chunks(self, episodes: NDArray[np.int64], rows: NDArray[np.int64], length: int) -> Floats:
        """Return the set-points that follow rows (E, R) of episodes (E,), relative to those now, (E, R, length, 23)."""
        # Beyond the end they stand still.
        ahead = np.minimum(rows[..., None] + np.arange(length), self.steps[episodes][:, None, None] - 1)
        first = self.first[episodes][:, None]
        return self.meant[first[..., None] + ahead] - self.targets[first + rows][:, :, None]

    def batch(self, episodes: NDArray[np.int64], rows: NDArray[np.int64], length: int) -> Batch:
        """Return rows (E, R) of episodes (E,)."""
        looks = self.looks[self.first[episodes][:, None] + rows]
        return Batch(looks, self.points[episodes], self.chunks(episodes, rows, length))

    def draw(
        self, rng: np.random.Generator, among: NDArray[np.int64], episodes: int, rows: int, length: int
    ) -> Batch:
        """Draw a batch; long episodes come as often as short ones."""
        chosen = rng.choice(among, episodes, replace=len(among) < episodes)
        return self.batch(
            chosen, (rng.random((episodes, rows)) * self.steps[chosen][:, None]).astype(int), length
        )


def read_rows(folders: Sequence[Path], view: str) -> tuple[Rows, dict[str, str]]:
    """Read demonstrations.

    Args:
        folders: of `dexgrasp demos generate`.
        view: `state` or `cloud`.

    Returns:
        The rows, and the modes (`obs_mode`, `control_mode`) that the demonstrations are in.

    Raises:
        InputError: for folders without demonstrations, of different modes, or without what `view` looks at.
    """
    modes: dict[str, str] = {}
    parts: list[tuple[Floats, ...]] = []
    for folder in folders:
        settings = read_about(folder)["settings"]
        found = {key: str(settings[key]) for key in ("obs_mode", "control_mode")}
        if modes and modes != found:
            raise InputError(
                f"{folder} has {found}, the first {modes}: demonstrations of one kind are wanted"
            )
        modes = found
        noise = float(settings["noise"])
        parts += [_parts(view, episode, folder, noise) for episode in read_episodes(folder)]
    if not parts:
        raise InputError("no demonstrations: name folders of `dexgrasp demos generate`")
    looks, targets, meant, points = zip(*parts, strict=True)
    steps = np.array([len(part) for part in looks])
    ways = (np.concatenate(targets), np.concatenate(meant))
    arrays = (np.concatenate(looks), *ways, np.cumsum(steps) - steps, steps, np.stack(points))
    return Rows(*arrays, key=content_hash(*arrays)), modes


def _parts(view: str, episode: Episode, folder: Path, noise: float) -> tuple[Floats, ...]:
    seen = episode.observations
    first = {key: array[0] for key, array in seen.items()} | episode.once
    needed = "object_pose" if view == "state" else "cloud"
    if needed not in first:
        raise InputError(f"{folder} has no {needed}: a policy from {view} cannot be cloned from it")
    scene = first_look(view, first)
    now = {key: array[:-1] for key, array in seen.items()}
    looks = features(view, scene, now, np.arange(len(episode)))
    points = scene.points if view == "cloud" else np.zeros((0, 3), np.float32)
    assert len(points) in (0, POINTS)
    targets = np.asarray(seen["joint_targets"], dtype=float)
    robot = default_cell().robot
    meant = intended(targets, noise, episode.about["agent_seed"], robot) if noise else targets
    return looks.astype(np.float32), targets[:-1].astype(np.float32), meant[1:].astype(np.float32), points
