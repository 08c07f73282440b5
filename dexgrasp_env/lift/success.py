"""Success, stability and failure, as functions of arrays with leading batch axes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.lift.constants import (
    HOLD_STEPS,
    LIFT_HEIGHT,
    OFF_TABLE,
    STABLE_SLIP,
    STABLE_TILT,
    WORKSPACE_HIGH,
    WORKSPACE_LOW,
)
from dexgrasp_env.lift.state import Array, LiftState, ObjectConstants, lowest_point
from dexgrasp_env.poses import quat_conjugate, quat_multiply, rotate, rotation_angle

_LOW, _HIGH = np.array(WORKSPACE_LOW), np.array(WORKSPACE_HIGH)
STAGES = ("untouched", "touched", "lifted", "dropped", "held")
_STAGES = np.array(STAGES)


@dataclass(frozen=True)
class Progress:
    """What an episode has achieved so far; every array has the batch shape (...)."""

    held_steps: NDArray[np.int64]  # consecutive control steps at height, held by the hand alone
    touched: NDArray[np.bool_]
    lifted: NDArray[np.bool_]  # reached LIFT_HEIGHT at some time
    airborne: NDArray[np.bool_]  # off the table now
    grip_position: Array  # (..., 3) object in the palm frame when it left the table
    grip_quat: Array  # (..., 4)
    slip: Array  # m, largest distance from grip_position since
    tilt: Array  # rad, largest rotation from grip_quat since
    height: Array  # m, lowest point above the table

    @classmethod
    def start(cls, shape: tuple[int, ...] = ()) -> "Progress":
        """Return the progress at reset."""
        false, zero = np.zeros(shape, bool), np.zeros(shape)
        return cls(
            np.zeros(shape, np.int64), false, false, false, np.zeros((*shape, 3)),
            np.broadcast_to([1.0, 0, 0, 0], (*shape, 4)).copy(), zero, zero, zero,
        )  # fmt: skip

    @property
    def is_success(self) -> NDArray[np.bool_]:
        """Held at height by the hand alone for the last 3 s."""
        return self.held_steps >= HOLD_STEPS

    @property
    def is_stable(self) -> NDArray[np.bool_]:
        """Off the table, and moved little in the hand since it left."""
        return self.airborne & (self.slip < STABLE_SLIP) & (self.tilt < STABLE_TILT)

    @property
    def stage(self) -> NDArray[np.str_]:
        """How far the episode has come, one of `STAGES`."""
        at_height = self.held_steps > 0
        dropped = self.lifted & ~at_height
        rung = np.maximum(np.maximum(1 * self.touched, 3 * dropped), np.maximum(2 * at_height, 4 * self.is_success))
        return _STAGES[rung]


def advance(progress: Progress, state: LiftState, constants: ObjectConstants) -> Progress:
    """Return the progress after one more control step."""
    height = lowest_point(state, constants)
    alone = state.held_by_hand_alone
    at_height = (height >= LIFT_HEIGHT) & alone
    airborne = (height > OFF_TABLE) & alone
    return Progress(
        held_steps=(progress.held_steps + 1) * at_height,
        touched=progress.touched | state.touched_by_hand,
        lifted=progress.lifted | at_height,
        airborne=airborne,
        height=height,
        **_motion_in_hand(progress, state, airborne),
    )


def _motion_in_hand(progress: Progress, state: LiftState, airborne: NDArray[np.bool_]) -> dict[str, Array]:
    """Where the object was in the hand when it left the table, and the largest motion since."""
    grip_position, grip_quat = progress.grip_position, progress.grip_quat
    if not airborne.any():
        zero = np.zeros_like(progress.slip)
        return {"grip_position": grip_position, "grip_quat": grip_quat, "slip": zero, "tilt": zero}
    position, quat = _object_in_palm(state)
    took_off = airborne & ~progress.airborne
    if took_off.any():
        grip_position = np.where(took_off[..., None], position, grip_position)
        grip_quat = np.where(took_off[..., None], quat, grip_quat)
    # Where the object has just left the table both are 0: the grip is where it is.
    slip = np.sqrt(((position - grip_position) ** 2).sum(-1))
    tilt = rotation_angle(quat_multiply(quat_conjugate(grip_quat), quat))
    return {
        "grip_position": grip_position,
        "grip_quat": grip_quat,
        "slip": np.where(airborne, np.maximum(progress.slip, slip), 0.0),
        "tilt": np.where(airborne, np.maximum(progress.tilt, tilt), 0.0),
    }


def _object_in_palm(state: LiftState) -> tuple[Array, Array]:
    inverse = quat_conjugate(state.palm_quat)
    return rotate(inverse, state.object_position - state.palm_position), quat_multiply(inverse, state.object_quat)


def object_lost(state: LiftState) -> NDArray[np.bool_]:
    """(...,): the object's centre has left the workspace."""
    position = state.object_position
    return ((position < _LOW) | (position > _HIGH)).any(-1)


def diverged(state: LiftState) -> NDArray[np.bool_]:
    """(...,): a number of the simulation is no longer finite."""
    return np.logical_not(np.isfinite(state.qpos.sum(-1) + state.qvel.sum(-1)))  # one bad number spoils the sum
