"""A grasp of a floating hand, as every protocol takes it, whatever file it came from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dexgrasp.scoring.hand import HandModel
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.model import ObjectModel


@dataclass(frozen=True)
class HandStage:
    """Where the hand is asked to be.

    Attributes:
        T_world_hand: (4, 4) of the hand's frame; z up, the table's top at z = 0.
        joints: (n,) rad or m, set-points in the order of the hand's joints.
    """

    T_world_hand: Array
    joints: Array


@dataclass(frozen=True)
class Candidate:
    """A grasp to be scored.

    Attributes:
        source: the file it came from, with its number where the file holds several.
        hand: the hand.
        object: what is grasped, its frame at the centre of mass.
        T_world_object: (4, 4).
        pregrasp: around the object, touching nothing.
        grasp: in contact.
        squeeze: set-points inside the object.
        servo_kp: Nm/rad, of the servos that the squeeze is meant for; None where the file does not say, and the
            set-points are then taken as they are.
    """

    source: str
    hand: HandModel
    object: ObjectModel
    T_world_object: Array
    pregrasp: HandStage
    grasp: HandStage
    squeeze: HandStage
    servo_kp: float | None = None

    def squeeze_for(self, servo_kp: float | None) -> HandStage:
        """Return the squeeze for servos of another gain, so that they press with the same torques."""
        if self.servo_kp is None or servo_kp is None:
            return self.squeeze
        press = (self.squeeze.joints - self.grasp.joints) * (self.servo_kp / servo_kp)
        return replace(self.squeeze, joints=self.grasp.joints + press)

    def displaced(self, T: Array) -> "Candidate":
        """Return the grasp with the hand displaced by `T` (4, 4) in its own frame at every stage."""

        def moved(stage: HandStage) -> HandStage:
            return replace(stage, T_world_hand=stage.T_world_hand @ T)

        return replace(
            self, pregrasp=moved(self.pregrasp), grasp=moved(self.grasp), squeeze=moved(self.squeeze)
        )


def joints_in_order(hand: HandModel, names: Sequence[str], values: Array, source: str) -> Array:
    """Return joint values (..., n) in the hand's order from values named otherwise ordered.

    Raises:
        InputError: if names are missing, unknown or doubled, or a value is not finite.
    """
    values = np.asarray(values, dtype=float)
    if values.shape[-1] != len(names) or not np.isfinite(values).all():
        raise InputError(f"{source}: joints must be {len(names)} finite numbers, one for each joint name")
    if sorted(names) != sorted(hand.joint_names):
        strange = sorted(set(names) ^ set(hand.joint_names))
        raise InputError(
            f"{source}: joint names do not fit hand {hand.name} (differing: {', '.join(strange[:4])} "
            f"...): valid are {', '.join(hand.joint_names)}"
        )
    order = [list(names).index(name) for name in hand.joint_names]
    return values[..., order]


def as_pose(value: object, source: str, name: str) -> Array:
    """Return a pose (4, 4) from a matrix, or from 7 numbers (position, quaternion wxyz).

    Raises:
        InputError: if it is neither, or no rigid transform.
    """
    from dexgrasp_env.poses import pose_matrix

    try:
        T = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        T = np.zeros(0)
    if T.shape == (7,) and np.isfinite(T).all() and np.linalg.norm(T[3:]) > 1e-6:
        T = pose_matrix(T[:3], T[3:] / np.linalg.norm(T[3:]))
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise InputError(f"{source}: {name} must be a (4, 4) pose, or 7 numbers: position m, quaternion wxyz")
    R = T[:3, :3]
    if (
        np.abs(R @ R.T - np.eye(3)).max() > 1e-3
        or np.linalg.det(R) < 0
        or np.abs(T[3] - [0, 0, 0, 1]).max() > 1e-6
    ):
        raise InputError(f"{source}: {name} is no rigid transform (rotation, position, last row 0 0 0 1)")
    return T
