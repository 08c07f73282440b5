"""Set down what is lifted: carry it over a place, lower it there, let go and leave."""

from dataclasses import replace
from itertools import product
from math import inf

import numpy as np

from dexgrasp.geometry.request import Goal
from dexgrasp.geometry.surface_samples import triangle_samples
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame, reach_palm
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp.motion.carried import carried, let_go
from dexgrasp.motion.collision import CollisionChecker, carried_into
from dexgrasp.motion.motion import NoPath, arm_and_hand
from dexgrasp.planning.settings import GraspProblem
from dexgrasp_env.arrays import Array, middle
from dexgrasp_env.poses import about_z, placed, rigid
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.scene.constants import TABLE_CENTRE_X, TABLE_SIZE

OUT_OF_REACH = "goal_out_of_reach"
GoalPoses = list[tuple[Array, float]]
"""Motions (4, 4) of an object that bring it to a goal, and their turns, rad."""
RISES = (0.0, 0.12)
"""m beyond the lift that an object is carried higher."""


def set_down(
    script: ActionScript,
    problem: GraspProblem,
    leg: Array,
    rise: float,
    *,
    about: Array,
    turn: float | None = None,
    exact: bool = False,
) -> ActionScript | None:
    """Return a script that sets the object down in place of its hold; None where arm or object cannot go there.

    Args:
        script: that lifts it.
        problem: the object where it lies, and the robot.
        leg: (2,) m, the level way.
        rise: m that it is carried higher than the lift ends.
        about: (3,) m, the point of the object that goes that way, and about which it turns.
        turn: see `carried`.
        exact: within limits of acceleration too, and nearer to its way.
    """
    tree, target = problem.tree, problem.target
    # Share of the joints' limits, m that the palm may be off its way, a radian is 0.15 m, and m above the table where
    # it is let go of: what has turned in the hand is turned back by the table, and does not roll when it is let go of.
    speed, stray, above = (0.9, 0.004, 0.001) if exact else (inf, 0.01, 0.004)
    lifted, opened = script.phases["lift"][-1], script.phases["approach"][-1]
    up = palm_frame(lifted, tree)[1][2] - palm_frame(opened, tree)[1][2]
    at, now, error, phases = about + np.array([0.0, 0.0, up]), lifted, 0.0, dict(script.phases)
    del phases["hold"]
    for name, way, turned in (
        ("rise", [0.0, 0.0, rise], None),
        ("carry", [*leg, 0.0], turn),
        ("set_down", [0.0, 0.0, above - up - rise], None),
    ):
        phases[name], strayed = carried(now, at, np.array(way), tree, turned, speed)
        error, at, now = max(error, strayed), at + way, phases[name][-1]
    rows = np.concatenate([lifted[None], phases["rise"], phases["carry"], phases["set_down"]])
    if (
        error > stray
        or CollisionChecker(problem.cell, target.around, 0.0).first_contact(rows) is not None
        or carried_into(target, rows, tree, script.phases["squeeze"][-1]) > 0.0
    ):
        return None
    phases["carry"] = np.concatenate([phases.pop("rise"), phases["carry"]])
    phases["release"] = let_go(now, free := arm_and_hand(now, opened, tree))
    phases["retreat"] = carried(free, at, np.array([0.0, 0.0, 0.12]), tree, None, speed)[0]  # m up
    return ActionScript(phases, script.start)


def to_goal(script: ActionScript, problem: GraspProblem, poses: GoalPoses) -> ActionScript:
    """Return a script that sets the object down at one of its poses at a goal, and leaves it there untouched.

    Raises:
        NoPath: `goal_out_of_reach`, where arm or object cannot go there, or `goal_release_blocked`.
    """
    reason = NoPath(OUT_OF_REACH, "arm or object cannot go there from this grasp")
    target, cell = problem.target, problem.cell
    about = _foot(target)
    for (T, turn), rise in product(poses, RISES):
        leg = placed(T, about)[:2] - about[:2]
        if (way := set_down(script, problem, leg, rise, about=about, turn=turn, exact=True)) is None:
            continue
        there = _moved(target, T)
        checks = (there.around, way.way("release")), (there.everything, way.phases["retreat"])
        if all(CollisionChecker(cell, free_of, 0.0).first_contact(rows) is None for free_of, rows in checks):
            return way
        reason = NoPath("goal_release_blocked", "the open hand would meet something there")
    raise reason


def reaches_goal(q: Array, poses: GoalPoses, tree: RobotTree) -> bool:
    """Return True if the arm reaches one of the poses at a goal with the palm at the object as at `q` (n,) rad."""
    R, p = palm_frame(q, tree)
    return any(reach_palm(q.copy(), T[:3, :3] @ R, placed(T, p), tree) for T, _ in poses)


def goal_poses(target: GraspTarget, goal: Goal, cell: Cell) -> GoalPoses:
    """Return the poses at which an object may stand at a goal.

    Raises:
        NoPath: where there is none, and so nothing can set it down there.
    """
    if abs(placed(cell.T_world_base, goal.place)[2]) > 0.01:  # m that a goal may be off the table's top
        raise NoPath("goal_not_on_table", "its height is not the table's")
    if _leans(target):
        raise NoPath("goal_not_stable", "the object does not stand by itself")
    found = _poses(target, goal, cell)
    faults = [fault_at(target, T) for T, _ in found]
    if None not in faults:
        raise NoPath(str(faults[0]), "in every heading that is asked for")
    return [pose for pose, fault in zip(found, faults, strict=True) if fault is None]


def fault_at(target: GraspTarget, T: Array) -> str | None:
    """Return why an object moved by `T` (4, 4) cannot stand there: off the table, or where something stands."""
    corners = placed(T, target.corners)
    half = 0.5 * np.array(TABLE_SIZE[:2])
    if (np.abs(corners[:, :2] - [TABLE_CENTRE_X, 0.0]) > half).any():
        return "goal_off_table"
    if target.around is None:
        return None
    moved = _moved(target, T).distance
    samples = triangle_samples(moved.triangles, 200, 0).points
    beside = np.concatenate([part for parts in target.neighbours for part in parts])
    near = min(target.around.distance(samples).min(), moved.distance(beside).min())
    return "goal_occupied" if near < 0.003 else None  # m that what is set down keeps from what stands there


def _moved(target: GraspTarget, T: Array) -> GraspTarget:
    """Return the object moved by `T` (4, 4), among what stands there."""
    moved = GraspTarget.of_corners([placed(T, part) for part in target.distance.corners])
    return replace(moved, neighbours=target.neighbours)


def _poses(target: GraspTarget, goal: Goal, cell: Cell) -> GoalPoses:
    foot, place = _foot(target), placed(cell.T_world_base, goal.place)
    found = []
    headings = [0.0, 45.0, -45.0, 90.0, -90.0, 180.0] if goal.yaw is None else [goal.yaw]
    for turn in np.deg2rad(headings):
        R = about_z(turn)
        found.append((rigid(R, np.array([*place[:2], foot[2]]) - R @ foot), float(turn)))
    return found


def _foot(target: GraspTarget) -> Array:
    """Return the point (3,) m of the object that a goal is for: below the middle of its outline."""
    corners = target.corners
    return np.array([*middle(corners)[:2], 0.0])


def _leans(target: GraspTarget) -> bool:
    """Return True for an object that does not stand by itself: its centre is not over what it stands on."""
    corners = target.corners
    low = corners[corners[:, 2] < corners[:, 2].min() + 0.004][:, :2]  # m: these bear it
    off = np.maximum(low.min(0) - target.centre[:2], target.centre[:2] - low.max(0))
    return bool(off.max() > 0.005)  # m outside of them
