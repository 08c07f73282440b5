"""Our own grasp files (`dexgrasp plan --out`): of arm and hand, the palm's pose and the hand's joints are kept."""

from pathlib import Path

import mujoco

from dexgrasp.grasp.file import read_grasp
from dexgrasp.scoring.candidate import Candidate, HandStage
from dexgrasp.scoring.hand import ALLEGRO, find_hand
from dexgrasp.scoring.readers.objects import ReadOptions, find_object
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import pose_matrix
from dexgrasp_env.robot.cell import Cell, make_cell
from dexgrasp_env.robot.model import compiled_robot

SERVO_KP = 10.0  # Nm/rad, of the hand that the squeeze is made for


def read_ours(path: Path, options: ReadOptions) -> list[Candidate]:
    """Return the grasp of a file; the object's true pose must be in it.

    Raises:
        InputError: if the file is unusable, of another cell, knows no true pose, or its object is not found.
    """
    record = read_grasp(path, make_cell(options.robot))
    record.check_cell()
    if record.T_world_object is None:
        raise InputError(
            f"{path}: T_world_object is missing: a grasp planned on a cloud alone cannot be simulated"
        )
    identity = record.object
    target = find_object(identity.source or identity.name, identity.scale, options, path)
    cell, motion = record.grasp.cell, record.grasp.motion
    first, middle, last = (_stage(cell, q) for q in (motion.pregrasp, motion.grasp, motion.squeeze))
    hand, pose = find_hand(ALLEGRO), record.T_world_object
    return [Candidate(str(path), hand, target, pose, first, middle, last, SERVO_KP)]


def _stage(cell: Cell, q: Array) -> HandStage:
    """Return palm and hand of a configuration (n,)."""
    model, robot = compiled_robot(cell), cell.robot
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    palm = data.site(robot.hand.palm)
    T = pose_matrix(palm.xpos.copy(), data.body(robot.hand.palm).xquat.copy())
    return HandStage(T, q[robot.hand_columns].copy())
