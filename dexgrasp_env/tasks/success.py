"""Success, stability and failure, as functions of arrays with leading batch axes."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import components, join, product_components, rotated_components
from dexgrasp_env.tasks.arithmetic import choose, most, root, some
from dexgrasp_env.tasks.constants import (
    HOLD_STEPS,
    LIFT_HEIGHT,
    OFF_TABLE,
    STABLE_SLIP,
    STABLE_TILT,
    WORKSPACE_HIGH,
    WORKSPACE_LOW,
)
from dexgrasp_env.tasks.state import LiftState, ObjectConstants, lowest_point

STAGES = ("untouched", "touched", "lifted", "dropped", "held")
_STAGES = np.array(STAGES)


@dataclass(frozen=True)
class Progress:
    """What an episode has achieved so far: of one environment plain numbers, of many arrays (...)."""

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

        def zero(kind: Any) -> Any:
            return np.zeros(shape, kind) if shape else kind(0)

        unturned = np.broadcast_to([1.0, 0, 0, 0], (*shape, 4)).copy()
        return cls(
            zero(int), zero(bool), zero(bool), zero(bool), np.zeros((*shape, 3)), unturned,
            zero(float), zero(float), zero(float),
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
    def stage(self) -> Any:
        """How far the episode has come, one of `STAGES`."""
        at_height = self.held_steps > 0
        dropped = self.lifted > at_height  # was at height, is not now
        rung = most(most(1 * self.touched, 3 * dropped), most(2 * at_height, 4 * self.is_success))
        return STAGES[rung] if isinstance(rung, int) else _STAGES[rung]


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
    if not some(airborne):
        zero = 0.0 * progress.slip
        return {"grip_position": grip_position, "grip_quat": grip_quat, "slip": zero, "tilt": zero}
    position, quat = _object_in_palm(state)
    took_off = airborne > progress.airborne
    if some(took_off):
        new = np.asarray(took_off)[..., None]
        grip_position = np.where(new, join(*position), grip_position)
        grip_quat = np.where(new, join(*quat), grip_quat)
    # Where the object has just left the table both are 0: the grip is where it is.
    dx, dy, dz = (now - then for now, then in zip(position, components(grip_position), strict=True))
    w, x, y, z = product_components(_conjugate(components(grip_quat)), quat)
    tilt = 2.0 * np.arctan2(root(x * x + y * y + z * z), abs(w))
    return {
        "grip_position": grip_position,
        "grip_quat": grip_quat,
        "slip": choose(airborne, most(progress.slip, root(dx * dx + dy * dy + dz * dz)), 0.0),
        "tilt": choose(airborne, most(progress.tilt, tilt), 0.0),
    }


def _object_in_palm(state: LiftState) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Return the object's position (3) and quaternion (4) in the palm frame, number by number."""
    inverse = _conjugate(state.readings[state.sensors.palm_quat])
    pairs = zip(state.configuration[23:26], state.readings[state.sensors.palm_position], strict=True)
    offset = [of_object - of_palm for of_object, of_palm in pairs]
    return rotated_components(inverse, offset), product_components(inverse, state.configuration[26:30])


def _conjugate(quat: Any) -> tuple[Any, ...]:
    w, x, y, z = quat
    return w, -x, -y, -z


def object_lost(state: LiftState) -> NDArray[np.bool_]:
    """(...,): the object's centre has left the workspace."""
    x, y, z = state.configuration[23:26]
    (x0, y0, z0), (x1, y1, z1) = WORKSPACE_LOW, WORKSPACE_HIGH
    return (x < x0) | (x > x1) | (y < y0) | (y > y1) | (z < z0) | (z > z1)


def diverged(state: LiftState) -> NDArray[np.bool_]:
    """(...,): a number of the simulation is no longer finite."""
    total = sum(state.configuration) + sum(components(state.qvel))  # one bad number spoils the sum
    return (abs(total) < math.inf) ^ True
