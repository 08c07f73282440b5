"""Observations as functions of arrays with leading batch axes, and their spaces."""

from collections.abc import Mapping
from itertools import accumulate
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from dexgrasp_env.poses import join
from dexgrasp_env.tasks.arithmetic import least
from dexgrasp_env.tasks.constants import CLOUD_POINTS, HOLD_STEPS
from dexgrasp_env.tasks.state import LiftState, ObjectConstants
from dexgrasp_env.tasks.success import Progress

OBS_MODES = ("state", "pointcloud", "depth", "rgbd")
ROBOT_KEYS = {
    "joint_positions": 23,
    "joint_velocities": 23,
    "joint_targets": 23,
    "fingertip_positions": 12,
    "palm_pose": 7,
}
OBJECT_KEYS = {
    "object_pose": 7,
    "object_velocity": 6,
    "object_size": 3,
    "object_mass": 1,
    "fingertip_forces": 12,
    "progress": 2,
}


def robot_observation(state: LiftState) -> dict[str, NDArray[np.float32]]:
    """What the robot knows of itself, in every observation mode (float32, (..., n))."""
    parts = (
        state.joint_positions,
        state.joint_velocities,
        state.targets,
        state.sensordata[..., state.sensors.tip_positions],
        state.palm_position,
        state.palm_quat,
    )
    return _cut(np.concatenate(parts, axis=-1, dtype=np.float32), ROBOT_KEYS)


def object_observation(
    state: LiftState, progress: Progress, constants: ObjectConstants
) -> dict[str, NDArray[np.float32]]:
    """Privileged knowledge, in `state` mode alone (float32, (..., n))."""
    shape = state.qpos.shape[:-1]
    parts = (
        state.qpos[..., 23:30],
        state.object_velocity,
        _rows(constants.extents_and_mass, shape),
        state.sensordata[..., state.sensors.tip_forces],
        join(progress.height, least(progress.held_steps / HOLD_STEPS, 1.0)),
    )
    return _cut(np.concatenate(parts, axis=-1, dtype=np.float32), OBJECT_KEYS)


def observation_space(obs_mode: str, image_shape: tuple[int, int, int]) -> spaces.Dict:
    """Return the space of an observation mode.

    Args:
        obs_mode: one of `OBS_MODES`.
        image_shape: cameras, rows, columns.
    """
    keys = ROBOT_KEYS | (OBJECT_KEYS if obs_mode == "state" else {})
    content: dict[str, spaces.Space[Any]] = {
        key: spaces.Box(-np.inf, np.inf, (size,), np.float32) for key, size in keys.items()
    }
    if obs_mode == "pointcloud":
        content["cloud"] = spaces.Box(-np.inf, np.inf, (CLOUD_POINTS, 3), np.float32)
        content["cloud_normals"] = spaces.Box(-1.0, 1.0, (CLOUD_POINTS, 3), np.float32)
        content["cloud_mask"] = spaces.MultiBinary(CLOUD_POINTS)
        content["table_plane"] = spaces.Box(-np.inf, np.inf, (5,), np.float32)
    if obs_mode in ("depth", "rgbd"):
        content["depth"] = spaces.Box(0.0, np.inf, image_shape, np.float32)
    if obs_mode == "rgbd":
        content["rgb"] = spaces.Box(0, 255, (*image_shape, 3), np.uint8)
    return spaces.Dict(content)


def _rows(array: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Repeat an array (n,) along the batch axes; one that has them already stays as it is."""
    return array if array.shape[:-1] == shape else np.broadcast_to(array, (*shape, array.shape[-1]))


def _cut(flat: NDArray[np.float32], sizes: Mapping[str, int]) -> dict[str, NDArray[np.float32]]:
    """Cut the last axis into the keys of `sizes`, in their order."""
    ends = accumulate(sizes.values())
    return {key: flat[..., end - sizes[key] : end] for key, end in zip(sizes, ends, strict=True)}
