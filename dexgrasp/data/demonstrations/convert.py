"""Conversion of joint set-points to actions of each control mode."""

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.tasks.constants import PALM_STEP, PALM_TURN
from dexgrasp_env.tasks.control import max_step, normalise


def to_action(control_mode: str, now: Array, wanted: Array, tree: RobotTree, scale: float = 1.0) -> Single:
    """Return the action that moves the set-points to `wanted`, or as near as a control step of 50 ms allows.

    Args:
        control_mode: one of `DIRECT_MODES`.
        now: (n,) rad, set-points before the step.
        wanted: (n,) rad, set-points after it; `ee_delta` follows palm and hand, the arm may differ.
        tree: the robot.
        scale: `action_scale` of the environment.
    """
    if control_mode == "joint_position":
        return normalise(wanted, tree).astype(np.float32)
    if control_mode == "joint_delta":
        return np.clip((wanted - now) / (scale * max_step(tree)), -1.0, 1.0).astype(np.float32)
    (R, p), (R_wanted, p_wanted) = palm_frame(now, tree), palm_frame(wanted, tree)
    turn = Rotation.from_matrix(R_wanted @ R.T).as_rotvec()
    palm = np.concatenate([(p_wanted - p) / PALM_STEP, turn / PALM_TURN]) / scale
    return np.clip(np.concatenate([palm, normalise(wanted, tree)[tree.arm :]]), -1.0, 1.0).astype(np.float32)


def with_noise(control_mode: str, action: Array, noise: Array, robot: Robot) -> Array:
    """Return an action with noise added to its commands.

    Args:
        control_mode: one of `DIRECT_MODES`.
        action: (n,) of that mode.
        noise: (n,) shares of the largest motion of each joint in a control step.
        robot: that the action moves.
    """
    change = noise
    if control_mode != "joint_delta":
        change = 2.0 * noise * max_step(robot) / (robot.upper - robot.lower)
    if control_mode == "ee_delta":
        change = np.concatenate([noise[:6], change[robot.hand_columns]])  # the palm's six
    return np.clip(action + change, -1.0, 1.0)
