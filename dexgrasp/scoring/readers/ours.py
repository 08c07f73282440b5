"""Our own grasp files (`dexgrasp plan --out`): of arm and hand, the palm's pose and the hand's joints are kept."""

from functools import lru_cache
from pathlib import Path

import mujoco

from dexgrasp.grasp.file import read_grasp
from dexgrasp.scoring.candidate import Candidate, HandStage
from dexgrasp.scoring.hand import ALLEGRO, find_hand
from dexgrasp.scoring.readers.objects import ReadOptions, find_object
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import pose_matrix
from dexgrasp_env.robot.model import robot_spec
from dexgrasp_env.robot.names import ARM_JOINTS, PALM_SITE

SERVO_KP = 10.0  # Nm/rad, of the hand that the squeeze is made for


def read_ours(path: Path, options: ReadOptions) -> list[Candidate]:
    """Return the grasp of a file; the object's true pose must be in it.

    Raises:
        InputError: if the file is unusable, of another cell, knows no true pose, or its object is not found.
    """
    record = read_grasp(path)
    record.check_cell()
    if record.T_world_object is None:
        raise InputError(
            f"{path}: T_world_object is missing: a grasp planned on a cloud alone cannot be simulated"
        )
    identity = record.object
    target = find_object(identity.source or identity.name, identity.scale, options, path)
    mount, motion = record.grasp.mount, record.grasp.motion
    first, middle, last = (_stage(mount, q) for q in (motion.pregrasp, motion.grasp, motion.squeeze))
    hand, pose = find_hand(ALLEGRO), record.T_world_object
    return [Candidate(str(path), hand, target, pose, first, middle, last, SERVO_KP)]


def _stage(mount: str, q: Array) -> HandStage:
    """Return palm and hand of a configuration (23,)."""
    model = _robot(mount)
    data = mujoco.MjData(model)
    data.qpos[:23] = q
    mujoco.mj_kinematics(model, data)
    palm = data.site(PALM_SITE)
    T = pose_matrix(palm.xpos.copy(), data.body("palm").xquat.copy())
    return HandStage(T, q[len(ARM_JOINTS) :].copy())


@lru_cache(maxsize=4)
def _robot(mount: str) -> mujoco.MjModel:
    return robot_spec(mount).compile()
