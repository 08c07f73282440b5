"""The engines by name."""

import importlib
import importlib.util

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from engines.scene import World

PACKAGES = {"mujoco": "mujoco", "bullet": "pybullet", "drake": "pydrake"}
"""Engine -> the module that it needs."""
_INSTALL = {"bullet": "pybullet", "drake": "drake"}


class Mujoco:
    """A scene in MuJoCo, played open loop."""

    def __init__(self, model: mujoco.MjModel, start: Array, pose: Array) -> None:
        """Set the robot at joint angles (n,), rad, and the object at a pose (7,): position, quaternion wxyz."""
        self._model, self._data = model, mujoco.MjData(model)
        self.step_seconds = model.opt.timestep
        self._data.qpos[: len(start)] = self._data.ctrl[:] = start
        self._data.qpos[len(start) : len(start) + 7] = pose
        mujoco.mj_forward(model, self._data)

    def step(self, target: Array) -> None:
        """Advance one step under the servos, whose set-points are (n,) rad."""
        self._data.ctrl[:] = target
        mujoco.mj_step(self._model, self._data)

    def position(self) -> Array:
        """Return the place of the object's frame (3,), m."""
        return self._data.body("object").xpos.copy()

    def joints(self) -> Array:
        """Return the robot's joint angles (n,), rad."""
        return self._data.qpos[: self._model.nu].copy()

    def close(self) -> None:
        """MuJoCo frees its memory by itself."""


def make_world(engine: str, model: mujoco.MjModel, start: Array, pose: Array) -> World:
    """Return a scene in an engine.

    Args:
        engine: mujoco, bullet or drake.
        model: the scene's: one robot on its first bodies, then the bodies `table` and `object`.
        start: (n,) rad of the robot's joints.
        pose: (7,) of the object, position and quaternion wxyz.

    Raises:
        InputError: if the engine is not installed.
    """
    if importlib.util.find_spec(PACKAGES[engine]) is None:
        raise InputError(f"{engine} is not installed: pip install -c constraints.txt {_INSTALL[engine]}")
    if engine == "mujoco":
        return Mujoco(model, start, pose)
    module = importlib.import_module(f"engines.{engine}")
    world: World = getattr(module, engine.capitalize())(model, np.asarray(start), np.asarray(pose))
    return world
