"""Limits, timing and collisions of an exported trajectory, from the rows alone."""

import numpy as np

from dexgrasp.export.read import Recording, Rows
from dexgrasp.grasp.trajectory import limit_shares
from dexgrasp.grasp.verify.check import Check, at_least, at_most, flag
from dexgrasp.grasp.verify.scene import Scene
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import placed
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.robot import Arm, Hand

_PERIODS = {"arm": 0.001, "hand": 0.003}  # s: the arm takes 1 kHz, the hand 333 Hz
_TIME = 1e-9  # s


def check_trajectory(recording: Recording, cell: Cell) -> list[Check]:
    """Check everything that can be known of a trajectory before a robot moves; all of it must hold.

    Args:
        recording: as read.
        cell: in which it is to be carried out.

    Raises:
        InputError: if the files name a mount that the cell has not.
    """
    facts, arm, hand = recording.facts, recording.arm, recording.hand
    cell, apart = cell.mounted(facts.mount).seeing(facts.table), abs(arm.times[-1] - hand.times[-1])
    return [
        flag("cell: of another one", cell.stamp == facts.cell, f"this is {cell.stamp}"),
        _timing("arm", arm), _timing("hand", hand),
        at_most("arm and hand end together, apart by (s)", apart, _PERIODS["hand"], "", _TIME),
        _order(recording),
        *_limits("arm", arm, cell.robot.arm), *_limits("hand", hand, cell.robot.hand),
        *_collisions(recording, cell),
        *_grasp(recording),
    ]  # fmt: skip


def _grasp(recording: Recording) -> list[Check]:
    """Return the files' warning about a grasp that was written though `verify` rejects it."""
    rejected = recording.facts.rejected
    if not rejected:
        return []
    return [Check("grasp: checks of verify that fail", float(len(rejected)), ", ".join(rejected), False)]


def _timing(name: str, rows: Rows) -> Check:
    period = _PERIODS[name]
    off = np.abs(rows.times - period * np.arange(len(rows.times))).max()
    return at_most(f"{name}: times are multiples of {1000 * period:g} ms from 0, off by (s)", off, _TIME)


def _order(recording: Recording) -> Check:
    """Check that segments follow each other, from the first row to the last."""
    segments = recording.facts.segments.values()
    starts, ends = [one.start for one in segments], [one.end for one in segments]
    apart = np.subtract([*starts, recording.arm.times[-1]], [0.0, *ends])
    off = max(np.abs(apart).max(), np.subtract(starts, ends).max())
    return at_most("segments follow each other to the end, off by (s)", off, _PERIODS["arm"], "", _TIME)


def _limits(name: str, rows: Rows, part: Arm | Hand) -> list[Check]:
    q, joints = rows.positions, part.joints
    room = np.minimum(q - joints.lower, np.subtract(joints.upper, q)).min()
    quantities = ("velocity", "acceleration", "jerk")
    used = limit_shares(q, _PERIODS[name], *(np.array(getattr(joints, kind)) for kind in quantities))
    # A trajectory may use 95 % of a limit.
    return [
        at_least(f"{name}: inside the joint limits by (rad)", room, 0.0),
        *(
            at_most(f"{name}: share of the {quantity} limits", share, 0.95)
            for quantity, share in zip(quantities, used, strict=True)
        ),
    ]


def _collisions(recording: Recording, cell: Cell) -> list[Check]:
    """Check true collision shapes: robot to itself, table, neighbours, and the object that it approaches."""
    facts = recording.facts
    parts, around = (
        [placed(cell.T_world_base, part) for part in shapes] for shapes in (facts.parts, facts.around)
    )
    scene = Scene(cell, parts, (), around)
    words = {
        "self": "robot to itself",
        "hand_table": "robot to the table",
        "hand_object": "robot to the object on the approach",
        "hand_neighbour": "robot to what stands around",
        "hand_seen": "robot to the points that were seen",
    }
    least, times, rows = dict[str, float](), recording.arm.times, recording.at(recording.arm.times)
    for k in _looks(rows):
        for kind, value in scene.clearances(rows[k], tips_touch=False).items():
            if kind != "hand_object" or times[k] <= facts.segments["approach"].end:
                least[kind] = min(least.get(kind, np.inf), value)
    # m: deeper than this is a collision
    checks = [at_least(f"{words[kind]} (m)", value, 0.0, "", 1e-4) for kind, value in least.items()]
    if facts.placed is not None:
        start = min(np.searchsorted(times, facts.segments["retreat"].start), len(rows) - 1)
        checks.append(_leaving(facts.placed, recording, cell, rows[start:]))
    if around:
        end = facts.segments["set_down"].end if facts.placed is not None else times[-1]
        start = min(np.searchsorted(times, facts.segments["lift"].start), len(rows) - 1)
        lift = rows[start : np.searchsorted(times, end) + 1]
        lying, nearest = scene.carried(lift[_looks(lift)])
        checks.append(
            # m that the object may get deeper into a neighbour than it seems to lie in it
            at_least("object to what stands around, once lifted (m)", nearest, min(lying, 0.0), "", 0.002)
        )
    return checks


def _leaving(motion: Array, recording: Recording, cell: Cell, rows: Array) -> Check:
    """Check the way (T, n) rad back from the object, which was set down by a motion (4, 4), frame of the base."""
    parts = [placed(cell.T_world_base @ motion, part) for part in recording.facts.parts]
    scene = Scene(cell, parts, ())
    least = min(scene.clearances(rows[k], tips_touch=False)["hand_object"] for k in _looks(rows))
    return at_least("robot to the object on the retreat (m)", least, 0.0, "", 1e-4)


def _looks(rows: Array) -> list[int]:
    """Return which of rows (T, n) to look at: all but single steps between two of them turn no joint over 0.01 rad."""
    turned = np.concatenate([[0.0], np.abs(np.diff(rows, axis=0)).max(axis=1).cumsum()])
    found = [0]
    while (last := found[-1]) < len(rows) - 1:
        found.append(max(last + 1, int(np.searchsorted(turned, turned[last] + 0.01, side="right")) - 1))
    return found
