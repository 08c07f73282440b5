"""A grasp carried out: approach, close, squeeze, lift, hold, as set-points for every control step."""

import numpy as np

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.grasp import RAISED, GraspMotion
from dexgrasp.grasp.trajectory import ActionScript, bend, jerkiness
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame, shift_palm
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.motion.approach import TRIES, plan_approach
from dexgrasp.motion.collision import CollisionChecker, carried_into
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.timing import SPEED, ramp, smooth_steps, still, time_path
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.scene.constants import CONTROL_PERIOD
from dexgrasp_env.tasks.control import max_step

_BEND = 2.3e-3  # rad that a set-point of the approach may stand out of its neighbours' plane; `verify` allows 2.5e-3


def make_script(
    start: Array, motion: GraspMotion, obstacle: ConvexDistance | None, cell: Cell, *,
    margin: float = 0.004, among: bool = False,
) -> ActionScript:  # fmt: skip
    """Plan the approach and put all phases together; the same arguments give the same script bit for bit.

    Args:
        start: (n,) rad, the set-points now.
        motion: the grasp.
        obstacle: the object in the world frame, with what stands around it, or None to approach as if there were none.
        cell: of the robot.
        margin: clearance to keep on the approach, m.
        among: whether neighbours are there. Other grasps are then found sooner than long detours, so fewer tries are
            made; and detours bend: an approach that bends too much takes twice as long.

    Raises:
        NoPath: `approach_blocked` or `lift_out_of_reach`, with what is in the way.
    """
    tree = robot_tree(cell)
    start = np.asarray(start, dtype=float)
    lift = _lift(tree, motion)  # cheap, so that it fails first
    checker = CollisionChecker(cell, obstacle, margin)
    # of the sampling planner, among neighbours
    waypoints = plan_approach(checker, start, motion.pregrasp, 500 if among else TRIES)
    for slower in (1.0, 0.5) if among else (1.0,):  # corners of a sampled path bend less
        # Smoothing may overshoot by a hair where the pregrasp stands at the end of a joint's range.
        approach = np.clip(time_path(waypoints, tree, checker, slower * SPEED), tree.lower, tree.upper)
        if not among or bend(np.vstack([start, approach])) <= _BEND:
            break
    pieces = {  # s of each phase; servos of the arm, which lag by 0.1 s, settle before the close
        "approach": np.concatenate([approach, still(motion.pregrasp, 0.35)]),
        "close": _ramp(motion.pregrasp, motion.grasp, 0.6, tree),
        "squeeze": _ramp(motion.grasp, motion.squeeze, 0.4, tree),
        "lift": lift,
        "hold": still(lift[-1], 3.4),
    }
    return ActionScript(pieces, start)


def _ramp(a: Array, b: Array, seconds: float, tree: RobotTree) -> Array:
    """Go from `a` to `b` evenly, slower where a joint's velocity limit asks for it."""
    count = max(round(seconds / CONTROL_PERIOD), int(np.ceil((np.abs(b - a) / max_step(tree)).max())))
    return ramp(a, b, count)


def _lift(tree: RobotTree, motion: GraspMotion) -> Array:
    """Raise the palm straight up from the squeeze, (m, n)."""
    up = np.outer(RAISED * smooth_steps(round(1.2 / CONTROL_PERIOD)), [0.0, 0.0, 1.0])
    path, error = shift_palm(motion.squeeze, tree, up)
    if error > 0.01:  # m that the palm may stray at the end of the lift
        raise NoPath("lift_out_of_reach", f"the palm strays {1000 * error:.0f} mm from the way up")
    rise = palm_frame(path[-1], tree)[1][2] - palm_frame(motion.squeeze, tree)[1][2]
    if abs(rise - RAISED) > 4.5e-4:  # m that the lift may miss its height by; `verify` allows 5e-4
        raise NoPath("lift_out_of_reach", f"the lift ends {1000 * (RAISED - rise):.1f} mm short")
    way = np.vstack([motion.squeeze, path])
    fast = (np.abs(np.diff(way, axis=0)) / max_step(tree)).max()
    if fast > 1.0:
        raise NoPath("lift_out_of_reach", f"a joint would move at {fast:.1f} times its limit")
    jerk = jerkiness(way)
    # rad that a set-point of the lift may lie from its neighbours' cubic; `verify` allows 4e-3
    if jerk > 3e-3:  # the arm turns at a joint limit or near a singularity
        raise NoPath("lift_out_of_reach", f"a joint would jerk by {1000 * jerk:.0f} mrad on the way up")
    return path


def check_way(script: ActionScript, cell: Cell, target: GraspTarget) -> None:
    """Refuse what `verify` would refuse of a script: a bent approach, a squeeze or a lift in which something is met.

    Raises:
        NoPath: `approach_bends`, or `squeeze_blocked`, `lift_blocked` with what is in the way.
    """
    bent = bend(script.way("approach"))
    if bent > _BEND:
        raise NoPath("approach_bends", f"a set-point stands out by {1000 * bent:.1f} mrad")
    checker = CollisionChecker(cell, target.around, 0.0)
    for phase in ("squeeze", "lift") if target.around is not None else ("lift",):
        if (contact := checker.first_contact(script.way(phase))) is not None:
            raise NoPath(f"{phase}_blocked", str(contact))
    if (deeper := carried_into(target, script.way("lift"), robot_tree(cell))) > 0.0:
        raise NoPath("lift_blocked", f"the object {1000 * deeper:.0f} mm into what stands around it")
