"""Flat features of the state, for learners: none reveals the previous action, in a frame that turns with the object.

A policy that sees velocities, or how far the arm lags behind its set-points, learns to repeat what it did last, and
never closes the hand. So set-points, tips and palm relative to the object, and forces are given, and the object as it
first lay. Everything is seen from the arm's base turned to the object: scenes that differ by a turn about the base are
one scene to the network.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from dexgrasp_env.arrays import AnyArray, Array, Index, Single
from dexgrasp_env.poses import about_z, quat_to_matrix
from dexgrasp_env.tasks.records import Record

_LEVEL = np.linspace(0.0, np.pi, 12, endpoint=False)
_DIRECTIONS = np.stack([np.cos(_LEVEL), np.sin(_LEVEL)])  # (2, 12)
METRES = 10.0
"""Network units a metre."""
_STEPS = 100.0  # control steps that a unit of time lasts
_LONGEST = 250  # control steps after which the clock stands still
FARTHEST = 10.0
"""Largest absolute value of a feature that an environment gives."""
_FRICTION = 1  # column of the variation
_NUMBERS = np.array(
    [
        (0.0, 0.3), (0.51, 0.1), *[(0.5, 0.25)] * 12, (0.5, 0.3), (0.9, 0.5), *[(0.0, 1.0)] * 9, *[(0.8, 0.4)] * 3,
        (0.25, 0.2), (0.7, 0.2),
    ]
).T  # fmt: skip
"""Middles and spreads (2, C + 1) of `InitialScene.numbers` and of friction, over where and what `Lift` puts down."""

Observation = Mapping[str, AnyArray]


class InitialScene(NamedTuple):
    """Numbers of an episode's first observation.

    Attributes:
        azimuth: rad, a number, where the object lay, seen from the arm's base.
        origin: (3,) m, where the object first was.
        numbers: (C,) of the object.
    """

    azimuth: Any
    origin: Array
    numbers: Array


def entry(observation: Observation, key: str) -> Array:
    """Return what an observation has of a key, in double precision."""
    return np.asarray(observation[key], dtype=float)


def initial_scene(first: Observation) -> InitialScene:
    """Return what is remembered of an episode's first observation; the object is a box about its centre of mass."""
    pose = entry(first, "object_pose")
    size = entry(first, "object_size")
    azimuth = float(np.arctan2(pose[1], pose[0]))
    R = about_z(-azimuth) @ quat_to_matrix(pose[3:])
    reach = np.abs(_DIRECTIONS.T @ R[:2]) @ (0.5 * size)
    top = pose[2] + np.abs(R[2]) @ (0.5 * size)
    numbers = [
        azimuth, np.hypot(*pose[:2]), *METRES * reach, METRES * pose[2], METRES * top, *R.ravel(),
        *METRES * size, *entry(first, "object_mass"),
    ]  # fmt: skip
    return InitialScene(azimuth, pose[:3], np.array(numbers))


def features(scene: InitialScene, observation: Observation, step: Index | int) -> Array:
    """Return features (..., F) of observations (..., n) of one episode at control steps (...).

    A scene of N episodes, `stack_scenes`, has observations (N, n) of each at one control step.
    """
    turned = about_z(-scene.azimuth)
    back = turned.swapaxes(-1, -2)
    targets = np.array(observation["joint_targets"], dtype=float)
    targets[..., 0] -= scene.azimuth
    shape = targets.shape[:-1]
    at = entry(observation, "object_pose")[..., :3]
    palm = entry(observation, "palm_pose")
    tips, forces = (
        entry(observation, key).reshape(*shape, -1, 3) for key in ("fingertip_positions", "fingertip_forces")
    )
    flat = *shape, 3 * tips.shape[-2]
    parts = [
        targets,
        ((tips - at[..., None, :]) @ back * METRES).reshape(flat),
        _turn(palm[..., :3] - at, turned) * METRES,
        (turned @ quat_to_matrix(palm[..., 3:]))[..., :2].reshape(*shape, 6),
        np.broadcast_to(np.minimum(step, _LONGEST) / _STEPS, shape)[..., None],
        np.tanh(forces @ back / 5.0).reshape(flat),  # N, about what a tip presses with
        entry(observation, "progress") * [METRES, 1.0],
        _turn(at - scene.origin, turned) * METRES,
        np.broadcast_to(scene.numbers, (*shape, scene.numbers.shape[-1])),
    ]
    return np.concatenate(parts, axis=-1)


def stack_scenes(scenes: Sequence[InitialScene]) -> InitialScene:
    """Return N scenes as one whose entries have an axis (N,) in front."""
    return InitialScene(*map(np.array, zip(*scenes, strict=True)))


def _turn(vectors: Array, turned: Array) -> Array:
    """Return vectors (..., 3) turned, all alike or each by a matrix of its own."""
    if turned.ndim == 2:
        return vectors @ turned.T
    return (turned @ vectors[..., None])[..., 0]


class SceneFeatures:
    """The features of N episodes side by side, as `obs_mode="features"` gives them.

    Those of `features`, what is of the object as it first lay about its middle and in spreads, and friction; then the
    state in the grasp space where actions are of it. Where an action is a whole grasp, from home, they are of the
    object alone.
    """

    def __init__(self, number: int, whole: bool) -> None:
        self._whole = whole
        empty = {"object_pose": np.zeros(7), "object_size": np.zeros(3), "object_mass": np.zeros(1)}
        self._scenes = stack_scenes([initial_scene(empty)] * number)

    def begin(self, i: int, record: Record) -> None:
        """Take how the object of episode `i` lay at first, from the episode's record."""
        first = {
            "object_pose": record["laid"].astype(np.float32),
            "object_size": (2.0 * record["half_extents"]).astype(np.float32),
            "object_mass": np.array([record["mass"]], np.float32),
        }
        for values, own in zip(self._scenes, initial_scene(first), strict=True):
            values[i] = own

    def of(self, part: slice, state: Observation, steps: Index) -> Single:
        """Return the features (n, F) of a part of the episodes.

        Args:
            part: which.
            state: of `obs_mode="state"`, (n, ...) by key.
            steps: (n,) control steps since they began.
        """
        scenes = InitialScene(*(values[part] for values in self._scenes))
        laid = np.concatenate([scenes.numbers, state["variation"][:, _FRICTION : _FRICTION + 1]], axis=-1)
        parts = [(laid - _NUMBERS[0]) / _NUMBERS[1]]
        if not self._whole:
            now = features(scenes, state, steps)[:, : -scenes.numbers.shape[-1]]
            parts = [now, *parts, *([state["grasp_state"]] if "grasp_state" in state else [])]
        return np.clip(np.concatenate(parts, axis=-1), -FARTHEST, FARTHEST).astype(np.float32)

    def shape(self, space: Mapping[str, Any]) -> tuple[int, ...]:
        """Return (F,), where the state's space is this."""
        state = {key: np.zeros((1, *part.shape), np.float32) for key, part in space.items()}
        return self.of(slice(0, 1), state, np.zeros(1, np.int64)).shape[1:]
