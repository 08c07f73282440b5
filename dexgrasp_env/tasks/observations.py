"""Observations: their keys and spaces."""

from itertools import accumulate
from typing import Any

import numpy as np
from gymnasium import spaces

from dexgrasp_env.arrays import Single
from dexgrasp_env.perception.pipeline import COUNT
from dexgrasp_env.robot.robot import Robot

OBS_MODES = ("state", "pointcloud", "depth", "rgbd")
OBS_SUMS = (*OBS_MODES, *(f"state+{mode}" for mode in OBS_MODES[1:]))
"""Modes, and the state beside what cameras see: for a critic that knows more than the actor."""
FLAT = "features"
"""The mode of one array: what `features` makes of the state."""


def knows_state(obs_mode: str) -> bool:
    """Return whether the privileged state, which no camera shows, is observed."""
    return obs_mode.startswith("state") or obs_mode == FLAT


def key_sizes(obs_mode: str, robot: Robot) -> dict[str, int]:
    """Return the size of each key that is not a camera's."""
    n, tips = robot.dof, 3 * len(robot.hand.fingers)
    keys = {
        "joint_positions": n, "joint_velocities": n, "joint_targets": n, "fingertip_positions": tips, "palm_pose": 7
    }  # fmt: skip
    if not knows_state(obs_mode):
        return keys
    return keys | {
        "object_pose": 7, "object_velocity": 6, "object_size": 3, "object_mass": 1, "fingertip_forces": tips,
        "progress": 2, "variation": 6,
    }  # fmt: skip


def key_columns(obs_mode: str, robot: Robot) -> dict[str, slice]:
    """Return the columns of each such key in the rows that `kernel.conclude` writes, by key in alphabetical order."""
    sizes = key_sizes(obs_mode, robot)
    ends = dict(zip(sizes, accumulate(sizes.values()), strict=True))
    return {key: slice(ends[key] - sizes[key], ends[key]) for key in sorted(sizes)}


def observation_space(obs_mode: str, image_shape: tuple[int, int, int], robot: Robot) -> spaces.Dict:
    """Return the space of an observation mode: bounded where a bound exists.

    Args:
        obs_mode: one of `OBS_SUMS`.
        image_shape: cameras, rows and columns of the depth images.
        robot: that is observed.
    """
    parts: dict[str, spaces.Space[Any]] = {
        key: spaces.Box(*_bounds(key, size, robot), dtype=np.float32)
        for key, size in key_sizes(obs_mode, robot).items()
    }
    seen = obs_mode.removeprefix("state+")
    if seen == "pointcloud":
        parts["cloud"] = unbounded(COUNT, 3)
        parts["cloud_normals"] = spaces.Box(-1.0, 1.0, (COUNT, 3), np.float32)
        parts["cloud_mask"] = spaces.MultiBinary(COUNT)
        parts["table_plane"] = unbounded(5)
    if seen in ("depth", "rgbd"):
        parts["depth"] = spaces.Box(0.0, np.inf, image_shape, np.float32)
    if seen == "rgbd":
        parts["rgb"] = spaces.Box(0, 255, (*image_shape, 3), np.uint8)
    return spaces.Dict(parts)


def unbounded(*shape: int) -> spaces.Box:
    """Return the space of any numbers in an array of a shape."""
    return spaces.Box(-np.inf, np.inf, shape, np.float32)


def _bounds(key: str, size: int, robot: Robot) -> tuple[Single, Single]:
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    if key == "joint_targets":
        low, high = robot.lower, robot.upper
    elif key in ("palm_pose", "object_pose"):
        low[3:], high[3:] = -1.0, 1.0
    elif key in ("object_size", "object_mass", "variation"):
        low[:] = 0.0
    elif key == "progress":
        low[1], high[1] = 0.0, 1.0
    return low.astype(np.float32), high.astype(np.float32)
