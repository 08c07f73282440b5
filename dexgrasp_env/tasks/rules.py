"""Constants of an environment that the compiled functions read."""

from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.scene.sensors import READINGS
from dexgrasp_env.tasks.constants import DISTURB_AFTER, GRASP_STEPS, HOLD_STEPS, at_pace
from dexgrasp_env.tasks.settings import LiftSettings

(TIPS, PALM, PALM_QUAT, TIP_FORCES, TOUCHING_ANY, TOUCHING_HAND, PRESSES) = range(len(READINGS))


class Rules(NamedTuple):
    """Constants of an environment: sensor columns, lengths in control steps, hulls and weights.

    Attributes:
        at: (7,) first columns of the readings in `sensordata`, in the order of `READINGS`.
        joints: n, of the robot.
        fingers: of the hand.
        grasp: (G,) numbers of the fingers of a grasp; the first opposes the others.
        hulls: (V, 3) hull vertices of all objects, m, object frames.
        hold: control steps of the hold.
        grasped: of these, at least so many must be grasps.
        wait: control steps held after which the disturbance begins.
        length: of the disturbance, control steps.
        bad_numbers: the bits of MuJoCo's warnings after which numbers are no physics.
        weights: (T,) of the reward's terms.
        dense: whether the reward is what the weighted sum of the terms gains in a control step, else success.
    """

    at: Index
    joints: int
    fingers: int
    grasp: Index
    hulls: Array
    hold: int
    grasped: int
    wait: int
    length: int
    bad_numbers: int
    weights: Array
    dense: bool


def rules_of(settings: LiftSettings, at: Index, hulls: Array, bad_numbers: int) -> Rules:
    """Return the rules of an environment; arguments as of `Rules`."""
    hand, pace = settings.cell.robot.hand, settings.frame_skip
    fingers = [finger.name for finger in hand.fingers]
    return Rules(
        at=at, joints=settings.cell.robot.dof, fingers=len(fingers),
        grasp=np.array([fingers.index(name) for name in hand.grasp]), hulls=hulls,
        hold=at_pace(HOLD_STEPS, pace), grasped=at_pace(GRASP_STEPS, pace), wait=at_pace(DISTURB_AFTER, pace),
        length=settings.disturbance_steps, bad_numbers=bad_numbers,
        weights=np.array(list(settings.weights.values())), dense=settings.reward_mode == "dense",
    )  # fmt: skip
