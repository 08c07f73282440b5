"""Ways of what the hand holds: straight, or turned about its centre in the air; letting go of it, and the way home."""

from math import inf
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame, shift_palm
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.motion.approach import plan_approach
from dexgrasp.motion.collision import CollisionChecker
from dexgrasp.motion.motion import Played, arm_and_hand
from dexgrasp.motion.move_until_contact import GuardedGrasp
from dexgrasp.motion.timing import eased, is_gentle, ramp, smooth_steps, still, time_path, within_limits
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import about_z
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.scene.constants import CONTROL_PERIOD

STILL = 0.001
"""m that count as no way."""


def carried(
    targets: Array, middle: Array, leg: Array, tree: RobotTree, turn: float | None = None, speed: float = inf
) -> tuple[Array, float]:
    """Move an object straight, 1 cm a control step on average.

    Args:
        targets: (n,) rad, set-points before.
        middle: (3,) m, of the object.
        leg: (3,) m, the way.
        tree: the robot.
        turn: rad about the vertical through its middle, on the way; None: it turns along about the robot's base.
        speed: share of the joints' limits, of acceleration too, that is used; infinite: all of their velocity.

    Returns:
        Set-points (m, n) rad, one a control step, and the largest error of the palm, m.
    """
    if np.abs(leg).max() < STILL and not turn:
        return targets[None], 0.0
    # m and rad a control step, on average
    steps = max(int(np.linalg.norm(leg) / 0.01), int(abs(turn or 0.0) / 0.05))
    shares = np.linspace(0.0, 1.0, steps + 2)[1:]
    ends = middle + shares[:, None] * leg
    azimuths = np.arctan2(ends[:, 1], ends[:, 0]) - np.arctan2(middle[1], middle[0])
    if turn is not None:
        azimuths = turn * shares
    turns = np.stack([about_z(angle) for angle in azimuths])
    arm = palm_frame(targets, tree)[1] - middle
    path, error = shift_palm(targets, tree, ends - middle + turns @ arm - arm, turns)
    points, count = np.vstack([targets, path]), len(path)
    while True:
        timed = eased(points, count)
        if is_gentle(targets, timed, tree, speed):
            return timed, error
        count = int(1.3 * count) + 1


class Turn(NamedTuple):
    """A turn of hand and object about the object's centre, after the lift: what friction held then lies on fingers."""

    arm: Array  # (m, a) rad, set-points of the arm, one a control step
    forces: Array  # (3, 3) N on the object, to press with at its end; in the axes of the grasp before it


def turn_arm(
    start: Array,
    vector: Array,
    centre: Array,
    corners: Array,
    cell: Cell,
    neighbours: ConvexDistance | None = None,
) -> Array | None:
    """Return set-points (m, a) rad that turn hand and object, None where the arm or the table is in the way.

    The object's centre rises as far as keeps its lowest corner where it is.

    Args:
        start: (n,) rad, set-points before.
        vector: (3,) rad, rotation vector.
        centre: (3,) m, of the object.
        corners: (K, 3) m, of the object, from its centre.
        cell: of the robot.
        neighbours: what stands on the table, in the way of hand and object; None where there is nothing.
    """
    tree = robot_tree(cell)
    count = round(max(1.15 * float(np.linalg.norm(vector)), 0.6) / CONTROL_PERIOD)  # s a radian
    turns = Rotation.from_rotvec(smooth_steps(count)[:, None] * vector).as_matrix()
    turned = (turns @ corners.T).transpose(0, 2, 1)
    arm = palm_frame(start, tree)[1] - centre
    shifts = turns @ arm - arm
    shifts[:, 2] += np.maximum.accumulate(np.maximum(corners[:, 2].min() - turned[..., 2].min(axis=1), 0.0))
    path, strayed = shift_palm(start, tree, shifts, turns)
    if (
        strayed > 0.005  # m that the palm may be off its way in a turn; a radian counts as 0.15 m
        or not within_limits(start, path, tree)
        or CollisionChecker(cell, neighbours, 0.0).first_contact(np.vstack([start, path])) is not None
    ):
        return None
    if neighbours is not None:
        moved = turned + (centre + shifts + arm - turns @ arm)[:, None]
        if neighbours.distance(moved).min() < 0.0:
            return None
    return path[:, : tree.arm]


def let_go(held: Array, opened: Array) -> Array:
    """Return set-points (m, n) rad that come to rest at `held` (n,), and open the hand to `opened` (n,)."""
    settle, opening = 6, 14  # control steps
    return np.concatenate([np.repeat(held[None], settle, axis=0), ramp(held, opened, opening)])


class CarryAside(Played):
    """Carries what was taken hold of to its place; nothing is felt. It is done when the hand has left the object."""

    def __init__(self, held: GuardedGrasp) -> None:
        """Prepare; `held` is done, and its script sets the object down."""
        arm, phases = held.tree.arm, held.script.phases
        rows = np.concatenate([phases[name] for name in ("lift", "carry", "set_down")])
        rows[:, arm:] = held.targets[arm:]
        opened = arm_and_hand(rows[-1], phases["retreat"][0], held.tree)
        super().__init__(np.concatenate([rows, let_go(rows[-1], opened), phases["retreat"]]), held.tree)


def plan_retreat(start: Array, cell: Cell, neighbours: ConvexDistance | None) -> Played:
    """Return the way home; where the object lies now nobody knows, so only its neighbours are kept clear of.

    Args:
        start: (n,) rad, the set-points now.
        cell: of the robot.
        neighbours: of the object; None where there is nothing.

    Raises:
        NoPath: where that, the table or the robot itself is in the way.
    """
    checker, home, tree = CollisionChecker(cell, neighbours), cell.robot.home, robot_tree(cell)
    start = np.clip(start, tree.lower, tree.upper)
    opened = arm_and_hand(start, home, tree)
    speed = 0.9  # of the limits: the hand is empty, and an episode has time for a second grasp only
    # Unchecked: pressing fingers are set inside one another.
    opening = time_path(np.stack([start, opened]), tree, speed=speed)
    way = time_path(plan_approach(checker, opened, home), tree, checker, speed)
    rows = np.concatenate([opening, way, still(home, 0.35)])  # s at home: the arm's servos lag by 0.1 s
    return Played(np.clip(rows, tree.lower, tree.upper), tree)
