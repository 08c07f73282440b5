"""An action space of grasping: the palm's place about the object, and the hand's closing.

In an action space of joints, or of steps of the palm, a grasp is a long run of numbers that all have to be right, and
exploring by noise hardly ever meets it. Here a grasp is nearly one point, and its phases are a few of them: palm above,
down, hand closed, palm up. Set-points that are held for several control steps make the way to a reward shorter still.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.agent import Observation
from dexgrasp.learning.imitation.state_features import entry
from dexgrasp.mechanics.kinematics.palm_ik import hanging_palm
from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.poses import about_z, quat_to_matrix
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.tasks.constants import PALM_STEP, PALM_TURN
from dexgrasp_env.tasks.control import normalise

_PALM = {
    "along": (0.0, 0.05),
    "across": (0.0, 0.05),
    "above": (0.11, 0.13),
    "turned": (0.0, 0.3),
    "tilted": (0.1, 0.2),
}
"""Middle and span of the palm's place, m, along the object's narrowest level direction, level across it, and above its
top (from where tips clear the table on); rad from closing along that direction, and of the thumb upwards.

The object is taken for its box, `object_size` about the centre of mass: where that is not the middle, the top is off.
"""
_OPEN = {
    "index": (-0.15, 0.86, 0.0, 0.04),
    "middle": (0.06, 0.86, 0.0, 0.07),
    "ring": (0.0, -0.15, 0.0, 0.0),
    "thumb": (1.38, 0.35, -0.1, 0.2),
}
_CLOSED = {
    "fingers": {("index", 1): -0.1, ("index", 2): 1.1, ("middle", 1): -0.1, ("middle", 2): 1.1},
    "thumb": {("thumb", 2): 1.2},
}
"""Rad that joints of a finger are bent by from the open hand at 1; at -1 the hand is open."""
SIZE = len(_PALM) + len(_CLOSED)
"""Numbers of an action, each from -1 to 1; what lies beyond is folded back."""
FARTHEST = 3.0
"""That a network's answers may be from 0 before they are."""
_LEAST_Z = 0.12  # m above the table, where the tips still clear it
_GAIN, _FASTEST = 0.5, 0.8  # share of what is left that a control step goes, and of what it can go at most
_CLOSING = 0.1  # rad that a joint of the hand moves in a control step at most
_TURNS = np.deg2rad(np.arange(0.0, 180.0, 3.0))
_WIDER = 1.03, 0.003  # factor and m by which a grip may be wider than the narrowest
_ABOVE = list(_PALM).index("above")


def joint_changes(robot: Robot, table: Mapping[str, Mapping[tuple[str, int], float]]) -> Array:
    """Return the joint angles (n,) rad that each entry of a table, by finger and joint, adds."""
    rows = np.zeros((len(table), robot.dof))
    for row, joints in zip(rows, table.values(), strict=True):
        for (finger, k), size in joints.items():
            row[robot.columns[finger].start + k] = size
    return rows


class GraspSpace:
    """The grasp space of N episodes side by side; environments are in `ee_delta`."""

    def __init__(self, robot: Robot, firsts: Observation) -> None:
        """Take the first observations, (N, n) by key, of `obs_mode="state"`."""
        self._robot = robot
        opened = np.zeros(robot.dof)
        for finger, angles in _OPEN.items():
            opened[robot.columns[finger].start :][: len(angles)] = angles
        # The open hand (m,) and what it is bent by as fingers and thumb close, (2, m), rad.
        self._open = opened[robot.hand_columns]
        self._closing = joint_changes(robot, _CLOSED)[:, robot.hand_columns]
        count = len(firsts["object_pose"])
        self._origins, self._axes = np.zeros((count, 3)), np.zeros(count)
        self._middles, self._spans = np.tile(np.array(list(_PALM.values())).T[:, None], (1, count, 1))
        self.begin(slice(None), firsts)

    def begin(self, rows: Any, firsts: Observation) -> None:
        """Begin episodes anew at their first observations, (K, n) by key."""
        pose = entry(firsts, "object_pose")
        size = entry(firsts, "object_size")
        R = quat_to_matrix(pose[:, 3:])
        origins = pose[:, :3].copy()
        origins[:, 2] += 0.5 * (np.abs(R[:, 2]) * size).sum(axis=-1)
        self._origins[rows] = origins
        # No part of an action's range is under the table, where it would make no difference.
        middle, span = _PALM["above"]
        lowest = np.maximum(middle - span, _LEAST_Z - origins[:, 2])
        self._middles[rows, _ABOVE] = 0.5 * (middle + span + lowest)
        self._spans[rows, _ABOVE] = 0.5 * (middle + span - lowest)
        # The narrowest grip that turns the wrist least, by 90 degrees at most, as grips are alike that are turned by
        # 180: of round things all are as narrow.
        level = np.stack([np.cos(_TURNS), np.sin(_TURNS)])
        widths = (np.abs(np.einsum("nij,ik->njk", R[:, :2], level)) * size[:, :, None]).sum(axis=1)
        narrow = widths <= widths.min(axis=1, keepdims=True) * _WIDER[0] + _WIDER[1]
        off = (_TURNS - _yaw(firsts)[:, None] + 0.5 * np.pi) % np.pi - 0.5 * np.pi
        best = np.argmin(np.where(narrow, np.abs(off), np.inf), axis=1)
        self._axes[rows] = _yaw(firsts) + np.take_along_axis(off, best[:, None], 1)[:, 0]

    def state(self, observations: Observation, rows: Any = slice(None)) -> Array:
        """Return the state of palm and hand, (N, SIZE), as the action that would leave them where they are."""
        palm = entry(observations, "palm_pose")
        offset, axes = palm[:, :3] - self._origins[rows], self._axes[rows]
        c, s = np.cos(axes), np.sin(axes)
        R = quat_to_matrix(palm[:, 3:])
        turned = (_yaw(observations) - axes + np.pi) % (2 * np.pi) - np.pi
        places = np.stack(
            [
                c * offset[:, 0] + s * offset[:, 1],
                c * offset[:, 1] - s * offset[:, 0],
                offset[:, 2],
                turned,
                np.arcsin(np.clip(-R[:, 2, 2], -1.0, 1.0)),
            ],
            axis=1,
        )
        bent = entry(observations, "joint_positions")[:, self._robot.arm_dof :] - self._open
        closed = bent @ self._closing.T / (self._closing**2).sum(axis=1)
        return np.concatenate(
            [(places - self._middles[rows]) / self._spans[rows], 2.0 * closed - 1.0], axis=1
        )

    def env_actions(self, actions: Array, observations: Observation) -> Single:
        """Return the environments' actions (N, m): one control step towards the set-points (N, SIZE)."""
        actions = _folded(actions)
        along, across, above, turned, tilted = (self._middles + self._spans * actions[:, : len(_PALM)]).T
        c, s = np.cos(self._axes), np.sin(self._axes)
        goals = self._origins + np.stack([c * along - s * across, s * along + c * across, above], axis=1)
        palm = entry(observations, "palm_pose")
        bent = self._open + 0.5 * (actions[:, len(_PALM) :] + 1.0) @ self._closing
        targets = np.array(observations["joint_targets"], dtype=float)
        now = targets[:, self._robot.arm_dof :]
        now += np.clip(bent - now, -_CLOSING, _CLOSING)
        wanted = hanging_palm(about_z(self._axes + turned)[..., 0], tilted)
        turn = Rotation.from_matrix(wanted @ quat_to_matrix(palm[:, 3:]).swapaxes(1, 2)).as_rotvec()
        hand = normalise(targets, self._robot)[:, self._robot.arm_dof :]
        moves = [_step((goals - palm[:, :3]) / PALM_STEP), _step(turn / PALM_TURN), hand]
        return np.concatenate(moves, axis=1).astype(np.float32)


def _folded(actions: Array) -> Array:
    """Return numbers within -1 and 1, mirrored there as often as it takes.

    Were they clipped, a mean that has wandered off beyond an end would never hear of anything else again.
    """
    return 1.0 - np.abs((actions + 1.0) % 4.0 - 2.0)


def _yaw(observations: Observation) -> Array:
    """Return the level direction (N,) rad that the palms face."""
    R = quat_to_matrix(entry(observations, "palm_pose")[:, 3:])
    return np.arctan2(R[:, 1, 2], R[:, 0, 2])


def _step(left: Array) -> Array:
    """Return the step (N, 3) of what is left (N, 3), in its direction."""
    wanted = _GAIN * left
    lengths = np.linalg.norm(wanted, axis=1, keepdims=True)
    return wanted * np.minimum(1.0, _FASTEST / np.maximum(lengths, 1e-9))
