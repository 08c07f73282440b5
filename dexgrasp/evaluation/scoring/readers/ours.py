"""Our own grasp files (`dexgrasp plan --out`): of arm and hand, the palm's pose and the hand's joints are kept."""

from pathlib import Path

from dexgrasp.evaluation.scoring.hand import Candidate, HandStage, find_hand
from dexgrasp.evaluation.scoring.readers.objects import ReadOptions, find_object
from dexgrasp.grasp.file import record_of
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import rigid
from dexgrasp_env.robot.cell import Cell, make_cell


def read_ours(content: Fields, path: Path, options: ReadOptions) -> list[Candidate]:
    """Return the grasp that a file holds; the object's true pose must be in it.

    Raises:
        InputError: if the file is unusable, of another cell, read with another hand, knows no true pose, or its object
            is not found.
    """
    if options.hand != ReadOptions.hand:
        raise InputError(f"{path} names its robot: --hand is of files of others, --robot of ours")
    record = record_of(content, str(path), make_cell(options.robot))
    cell = record.check_cell()
    if record.T_world_object is None:
        raise InputError(
            f"{path}: T_world_object is missing: a grasp planned on a cloud alone cannot be simulated"
        )
    identity = record.object
    target = find_object(identity.source or identity.name, identity.scale, options, path)
    first, middle, last = (_stage(cell, q) for q in (record.pregrasp, record.grasp, record.squeeze))
    gains = cell.robot.stiffness[cell.robot.hand_columns]
    hand = find_hand(cell.robot.hand)
    return [Candidate(str(path), hand, target, record.T_world_object, first, middle, last, gains)]


def _stage(cell: Cell, q: Array) -> HandStage:
    """Return palm and hand of a configuration (n,)."""
    tree = robot_tree(cell)
    return HandStage(rigid(*palm_frame(q, tree)), q[tree.arm :].copy())
