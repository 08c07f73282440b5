"""What a cloned policy looks at: nothing that gives the last action away, in a frame that turns with the object.

A policy that sees velocities, or how far the arm lags behind its set-points, learns to repeat what it did last, and
never closes the hand. So set-points, tips and palm relative to the object, and forces are given, and the object as it
first lay. Everything is seen from the arm's base turned to the object: scenes that differ by a turn about the base are
one scene to the network.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import quat_to_matrix

VIEWS = ("state", "cloud")
"""What is looked at: the whole state, or joints and one look at a cloud."""
POINTS = 256
"""Points of a cloud that the network is given."""
_LEVEL = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
_DIRECTIONS = np.stack([np.cos(_LEVEL), np.sin(_LEVEL)])  # (2, 24)
_METRES = 10.0  # units a metre
_NEWTONS = 5.0  # N, about what a tip presses with
_STEPS = 100.0  # control steps that a unit of time lasts
_LONGEST = 250  # control steps after which the clock stands still

Observation = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Scene:
    """What is remembered of the first observation.

    Attributes:
        azimuth: rad, a number, where the object lay, seen from the arm's base.
        origin: (3,) m, where the object first was.
        numbers: (C,) of the object.
        points: (POINTS, 3) of its cloud about `origin`, network units; empty for `state`.
    """

    azimuth: Any
    origin: Array
    numbers: Array
    points: NDArray[np.float32]


def view_of(obs_mode: str) -> str:
    """Return which of `VIEWS` an observation mode gives.

    Raises:
        InputError: for one that gives none.
    """
    views = {"state": "state", "pointcloud": "cloud"}
    if obs_mode not in views:
        raise InputError(
            f"policies are cloned from state or pointcloud, not from {obs_mode!r}: choose another"
        )
    return views[obs_mode]


def first_look(view: str, first: Observation) -> Scene:
    """Return what is remembered of an episode's first observation.

    Raises:
        InputError: where it has no object to look at.
    """
    return _from_state(first) if view == "state" else _from_cloud(first)


def features(view: str, scene: Scene, observation: Observation, step: NDArray[np.int64] | int) -> Array:
    """Return features (..., F) of observations (..., n) of one episode at control steps (...).

    A scene of N episodes, `side_by_side`, has observations (N, n) of each at one control step.
    """
    turned = _back(scene.azimuth)
    targets = np.array(observation["joint_targets"], dtype=float)
    targets[..., 0] -= scene.azimuth
    shape = targets.shape[:-1]
    at = np.asarray(observation["object_pose"], dtype=float)[..., :3] if view == "state" else scene.origin
    palm = np.asarray(observation["palm_pose"], dtype=float)
    tips = np.asarray(observation["fingertip_positions"], dtype=float).reshape(*shape, 4, 3)
    parts = [
        targets,
        ((tips - at[..., None, :]) @ turned.swapaxes(-1, -2) * _METRES).reshape(*shape, 12),
        _turn(palm[..., :3] - at, turned) * _METRES,
        (turned @ quat_to_matrix(palm[..., 3:]))[..., :2].reshape(*shape, 6),
        np.broadcast_to(np.minimum(step, _LONGEST) / _STEPS, shape)[..., None],
    ]
    if view == "state":
        forces = np.asarray(observation["fingertip_forces"], dtype=float).reshape(*shape, 4, 3)
        progress = np.asarray(observation["progress"], dtype=float) * [_METRES, 1.0]
        moved = _turn(at - scene.origin, turned) * _METRES
        parts += [np.tanh(forces @ turned.swapaxes(-1, -2) / _NEWTONS).reshape(*shape, 12), progress, moved]
    else:
        # The hand alone: the lag of its closed fingers is how hard they press.
        lag = np.asarray(observation["joint_targets"], dtype=float) - observation["joint_positions"]
        parts.append(5.0 * lag[..., 7:])
    numbers = np.broadcast_to(scene.numbers, (*shape, scene.numbers.shape[-1]))
    return np.concatenate([*parts, numbers], axis=-1)


def _from_state(first: Observation) -> Scene:
    pose = np.asarray(first["object_pose"], dtype=float)
    size = np.asarray(first["object_size"], dtype=float)
    azimuth = float(np.arctan2(pose[1], pose[0]))
    R = _back(azimuth) @ quat_to_matrix(pose[3:])
    reach = np.abs(_DIRECTIONS[:, :12].T @ R[:2]) @ (0.5 * size)
    top = pose[2] + np.abs(R[2]) @ (0.5 * size)
    numbers = [
        azimuth, np.hypot(pose[0], pose[1]), *_METRES * reach, _METRES * pose[2], _METRES * top, *R.ravel(),
        *_METRES * size, *np.asarray(first["object_mass"], dtype=float),
    ]  # fmt: skip
    return Scene(azimuth, pose[:3], np.array(numbers), np.zeros((0, 3), np.float32))


def _from_cloud(first: Observation) -> Scene:
    if "cloud" not in first:
        raise InputError(
            "this policy looks at a point cloud: make the environment with obs_mode='pointcloud'"
        )
    points = np.asarray(first["cloud"], dtype=float)[np.asarray(first["cloud_mask"], dtype=bool)]
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 4:
        raise InputError("empty_cloud")
    centre = points.mean(axis=0)
    azimuth = float(np.arctan2(centre[1], centre[0]))
    local = (points - centre) @ _back(azimuth).T * _METRES
    reach = (local[:, :2] @ _DIRECTIONS).max(axis=0)
    top = _METRES * points[:, 2].max()
    numbers = np.array([azimuth, np.hypot(centre[0], centre[1]), *reach, _METRES * centre[2], top])
    chosen = np.linspace(0, len(local) - 1, POINTS).round().astype(int)
    return Scene(azimuth, centre, numbers, local[chosen].astype(np.float32))


def side_by_side(scenes: Sequence[Scene]) -> Scene:
    """Return N scenes as one whose entries have an axis (N,) in front."""
    parts = zip(
        *((scene.azimuth, scene.origin, scene.numbers, scene.points) for scene in scenes), strict=True
    )
    return Scene(*(np.array(part) for part in parts))


def _turn(vectors: Array, turned: Array) -> Array:
    """Return vectors (..., 3) turned, all alike or each by a matrix of its own."""
    if turned.ndim == 2:
        return vectors @ turned.T
    return (turned @ vectors[..., None])[..., 0]


def _back(azimuth: Array | float) -> Array:
    c, s = np.cos(azimuth), np.sin(azimuth)
    zero, one = np.zeros_like(c), np.ones_like(c)
    return np.moveaxis(np.array([[c, s, zero], [-s, c, zero], [zero, zero, one]]), (0, 1), (-2, -1))
