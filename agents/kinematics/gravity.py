"""What the hand's own weight asks of its joints."""

from functools import lru_cache

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.model import compiled_robot


@lru_cache(maxsize=4)
def _robot(mount: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = compiled_robot(mount)
    return model, mujoco.MjData(model)


def hand_gravity(q: Array, mount: str = "palm_normal") -> Array:
    """Return the torques (16,) Nm that hold the hand's joints against gravity at `q` (23,) rad, at rest.

    Raises:
        InputError: if the mount is not known.
    """
    model, data = _robot(mount)
    data.qpos[:23] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    torque = np.zeros(model.nv)
    mujoco.mj_rne(model, data, 0, torque)
    return torque[7:23]
