"""Records of episodes: progress, success, disturbance and failure, one record an environment, that `kernel` writes.

What a single task notes beside these is a record of its own, `Episodes.task_dtype`. Beside them stand the constants of
an environment, `Rules`, that the compiled functions read.
"""

from dataclasses import astuple
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.scene.constants import TIMESTEP
from dexgrasp_env.scene.sensors import READINGS
from dexgrasp_env.tasks.constants import DISTURB_AFTER, GRASP_STEPS, HOLD_STEPS, SHORTEST_SKIP, at_pace
from dexgrasp_env.tasks.randomisation import Variation
from dexgrasp_env.tasks.settings import WEIGHTS, LiftSettings

STAGES = ("untouched", "touched", "lifted", "dropped", "held")
FAILURES = ("", "object_lost", "simulation_diverged")
PHASES = ("none", "before", "running", "over")  # of the disturbance

EPISODE = np.dtype(
    [
        # What the episode is of; reset writes it.
        ("half_extents", "f8", (3,)),  # m, half the sides of the mesh's box, along the object's axes
        ("mass", "f8"),  # kg
        ("size", "f8"),  # factor on the object's lengths
        ("variation", "f8", (6,)),  # fields of `Variation`, as the privileged state shows them
        ("hull_first", "i8"),  # rows of the table of hull vertices
        ("hull_count", "i8"),
        ("latency", "i8"),  # physics steps by which commands come late
        ("laid", "f8", (7,)),  # the object's pose in the first observation, m and quaternion wxyz
        # How far it has come.
        ("elapsed", "i8"),  # control steps
        ("held", "i8"),  # consecutive control steps at height, held by the hand alone
        # A ring of the last of them: was it grasped?
        ("window", "u1", (at_pace(HOLD_STEPS, SHORTEST_SKIP),)),
        ("grasps", "i8"),  # how often it was
        ("touched", "?"),
        ("lifted", "?"),  # reached LIFT_HEIGHT at some time
        ("airborne", "?"),  # off the table now, by the hand alone
        ("grasped", "?"),  # thumb and a finger press from opposite sides now
        ("success", "?"),
        ("solved", "?"),  # was it one at any time?
        ("total", "f8"),  # weighted sum of the reward's terms
        ("stage", "i8"),  # of STAGES
        ("failure", "i8"),  # of FAILURES
        ("warnings", "i8"),  # one bit for each of MuJoCo's
        ("height", "f8"),  # m, lowest point above the table
        ("grip_position", "f8", (3,)),  # object in the palm frame when it left the table
        ("grip_quat", "f8", (4,)),
        ("slip", "f8"),  # m, largest distance from grip_position since
        ("tilt", "f8"),  # rad, largest rotation from grip_quat since
        ("progress", "f8", (2,)),  # height, and the share of the hold that is over
        ("stable", "?"),  # off the table, and neither has become large
        ("terms", "f8", (len(WEIGHTS),)),  # of the reward, each in [0, 1]
        # The disturbance.
        ("phase", "i8"),  # of PHASES
        ("disturbed", "i8"),  # control steps it has run
        ("origin", "f8", (3,)),  # object in the palm frame when it began
        ("shift", "f8"),  # m, largest distance from there since
    ],
    align=True,
)

COMMANDS = ("targets", "command", "before")
"""Set-points of the n joints beside a record, (3, n) rad: the agent's at the end of the control step, what the servos
are told then (targets and the shaking), and the command before, for late ones."""

INFOS = {
    "is_success": "success", "is_stable": "stable", "is_grasped": "grasped", "stage": "stage", "failure": "failure",
    "object_height": "height", "object_slip": "slip", "object_tilt": "tilt", "object_shift": "shift",
    "held_seconds": "held", "disturbance": "phase", "mujoco_warnings": "warnings",
}  # fmt: skip
"""Infos: of which field of a record; `held` counts steps."""
INFO_NAMES = {"stage": STAGES, "failure": FAILURES, "disturbance": PHASES}
"""Names of the values of infos that are numbers in a record."""

Records = NDArray[np.void]
"""Array of EPISODE records, (N,)."""
Record = Any
"""One of them as compiled code sees it, with fields as attributes."""


def new_record(model: ObjectModel, variation: Variation, hull: tuple[int, int], disturbed: bool) -> Records:
    """Return the record of an episode that begins, one of `EPISODE`.

    Args:
        model: of the object.
        variation: of it.
        hull: first row and number of its vertices in `Rules.hulls`.
        disturbed: whether a disturbance is to come.
    """
    record = np.zeros((), EPISODE)
    record["half_extents"] = 0.5 * model.extents * variation.size
    record["mass"] = model.mass * variation.mass * variation.size**3
    record["size"], record["variation"] = variation.size, astuple(variation)
    record["hull_first"], record["hull_count"] = hull
    record["latency"] = round(variation.latency / TIMESTEP)
    record["grip_quat"][0] = 1.0
    record["phase"] = PHASES.index("before" if disturbed else "none")
    return record


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
        best: whether it gains above its best so far alone.
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
    best: bool


def rules_of(settings: LiftSettings, at: Index, hulls: Array, bad_numbers: int) -> Rules:
    """Return the rules of an environment; arguments as of `Rules`."""
    hand, pace = settings.cell.robot.hand, settings.frame_skip
    fingers = [finger.name for finger in hand.fingers]
    return Rules(
        at=at, joints=settings.cell.robot.dof, fingers=len(fingers),
        grasp=np.array([fingers.index(name) for name in hand.grasp]), hulls=hulls,
        hold=at_pace(HOLD_STEPS, pace), grasped=at_pace(GRASP_STEPS, pace), wait=at_pace(DISTURB_AFTER, pace),
        length=settings.disturbance_steps, bad_numbers=bad_numbers,
        weights=np.array(list(settings.weights.values())), dense=settings.reward_mode != "sparse",
        best=settings.reward_mode == "best",
    )  # fmt: skip
