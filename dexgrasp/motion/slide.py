"""An object that lies flat, pushed over the table by two fingertips until it sticks out over an edge.

The tips of index and middle finger press on the table behind it, side by side across the way so that it does not turn,
and the palm goes ahead of them. Pressing on it from above would not do: what a tip drags with, it also presses the
object onto the table with.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.mechanics.kinematics.forward import fingertips
from dexgrasp.mechanics.kinematics.palm_ik import hanging_palm, palm_frame, palm_postures, shift_palm
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.motion.approach import plan_approach
from dexgrasp.motion.collision import CollisionChecker
from dexgrasp.motion.motion import NoPath, Played, arm_and_hand
from dexgrasp.motion.timing import eased, time_path, within_limits
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import quat_to_matrix, yaw_quat
from dexgrasp_env.robot.cell import Cell, default_cell
from dexgrasp_env.scene.constants import CONTROL_PERIOD

_SPACING = 0.01  # m between points of the push


class Push(NamedTuple):
    """A straight push of what lies on the table."""

    direction: Array  # (2,) level, unit
    distance: float  # m
    touch: Array  # (2,) m, the middle between the two tips' centres as they touch


class Slide(Played):
    """Carries a push out.

    Attributes:
        script: phases `reach`, `slide` and `leave`.
        push: that it carries out.
        moved: m that the tips have taken the object along, as the joints feel it; of use when it is done.
    """

    def __init__(self, script: ActionScript, push: Push, tree: RobotTree) -> None:
        """Prepare; `make_slide` plans one."""
        super().__init__(script.targets, tree)
        self.script, self.push, self.moved = script, push, 0.0
        self._leave = len(script.targets) - len(script.phases["leave"])

    def _next(self, q: Array) -> Array:
        if self._step == self._leave:
            middle = fingertips(q, self.tree)[1:, :2].mean(0)
            self.moved = max(float((middle - self.push.touch) @ self.push.direction), 0.0)
        return super()._next(q)


def can_push(cell: Cell) -> bool:
    """Return True where the cell's hand is the one whose fingers are known to push."""
    return cell.robot.hand.mjcf == default_cell().robot.hand.mjcf


def tips_apart(cell: Cell) -> float:
    """Return the distance, m, of the two tips that push."""
    index, middle = fingertips(_pushing(robot_tree(cell)), robot_tree(cell))[1:]
    return float(np.linalg.norm(index - middle))


def make_slide(push: Push, start: Array, target: GraspTarget, cell: Cell) -> Slide:
    """Plan a push and the way to where it begins.

    Args:
        push: of the object.
        start: (n,) rad, set-points now.
        target: the object as it lies.
        cell: of the robot.

    Raises:
        NoPath: `push_out_of_reach`, or `approach_blocked`.
    """
    tree = robot_tree(cell)
    way = _way(push, cell)
    if way is None:
        raise NoPath("push_out_of_reach", "the arm cannot take two fingertips along the whole way")
    checker = CollisionChecker(cell, target.distance, 0.004)  # m from what is approached
    reach = time_path(plan_approach(checker, start, way[0]), tree, checker)
    rest = 4  # control steps
    pieces = {
        "reach": np.concatenate([reach, np.repeat(way[:1], rest, axis=0)]),
        "slide": np.concatenate([_timed(way, tree), np.repeat(way[-1:], rest, axis=0)]),
        "leave": _timed(way[:-6:-1], tree),  # four points back from the end
    }
    kept = {name: np.clip(rows, tree.lower, tree.upper) for name, rows in pieces.items()}
    return Slide(ActionScript(kept, start), push, tree)


def _pushing(tree: RobotTree) -> Array:
    """Return a configuration (n,) rad whose index and middle finger are curled, the others straight."""
    q = np.zeros_like(tree.home)
    for first, end in tree.fingers[1:]:
        # rad: curled so that what resists a tip neither lifts it nor presses it down
        q[first:end] = (0.0, 0.2, 1.4, 0.8)
    return arm_and_hand(tree.home, np.clip(q, tree.lower + 0.01, tree.upper - 0.01), tree)


def _way(push: Push, cell: Cell) -> Array | None:
    """Return configurations (m, n) rad of a push that begins 2 cm before the object; None where there is none."""
    tree = robot_tree(cell)
    q = _pushing(tree)
    R0, p0 = palm_frame(q, tree)
    tips = (fingertips(q, tree)[1:] - p0) @ R0
    ahead = np.array([*push.direction, 0.0])
    before = 0.02  # m before the push
    # m that tips end short of where they are sent: the table's friction
    length = before + push.distance + 0.009
    along = np.linspace(length, 0.0, int(np.ceil(length / _SPACING)) + 1)
    for tilt in (0.09, 0.3):  # rad of the palm, first choice first
        R = hanging_palm(-ahead, tilt)
        line = (R @ (tips[0] - tips[1]))[:2]
        off_square = np.arctan(line @ push.direction / (line @ [-push.direction[1], push.direction[0]]))
        R = quat_to_matrix(yaw_quat(off_square)) @ R  # both tips touch a straight side at once
        # m of the tips' centres, at which they press on the table: what they push cannot lift them
        begin = np.array([*(push.touch - before * push.direction), 0.0105]) - R @ tips.mean(0)
        # The end is next to the base, where the arm has the least room.
        for last in palm_postures(q, R, begin + length * ahead, tree):
            path, strayed = shift_palm(last, tree, (along[1:, None] - length) * ahead)
            way = np.vstack([last, path])[::-1]
            # The tips press on the table, and may be told to be 4.3 mm in it.
            if strayed < 0.003 and CollisionChecker(cell, None, -0.0043).first_contact(way) is None:
                return way
    return None


def _timed(path: Array, tree: RobotTree) -> Array:
    """Return set-points (T, n) rad along points `_SPACING` apart, from rest to rest."""
    seconds = max(_SPACING * (len(path) - 1) / 0.21, 0.4)  # m/s on average
    while True:
        rows = eased(path, round(seconds / CONTROL_PERIOD))
        if within_limits(path[0], rows, tree):
            return rows
        seconds *= 1.15
