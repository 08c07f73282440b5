"""A compiled scene in an engine, by name: set-points played in it; shapes, pairs that may touch, meshes for it."""

import importlib
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.model import excluded_pairs
from dexgrasp_env.scene.geom_mesh import geom_mesh

PACKAGES = {"mujoco": "mujoco", "bullet": "pybullet", "drake": "pydrake"}
"""Engine -> the module that it needs."""
_INSTALL = {"bullet": "pybullet", "drake": "drake"}


class World(Protocol):
    """A scene in an engine: built from MuJoCo's model, the robot's joint angles (n,) and the object's pose (7,).

    Attributes:
        step_seconds: s, of its physics.
    """

    step_seconds: float

    def step(self, target: Array) -> None:
        """Advance one step under servos with set-points (n,), rad."""

    def position(self) -> Array:
        """Return the place of the object's frame (3,), m."""

    def joints(self) -> Array:
        """Return the robot's joint angles (n,), rad."""

    def close(self) -> None:
        """Give back what is not freed by itself."""


class Mujoco(World):
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


@dataclass(frozen=True, eq=False)
class SetPoints:
    """Set-points of a robot of n joints over time, each row held until the next.

    Attributes:
        times: (T,) s.
        rows: (T, n) rad.
        judged: s from which on the object has to be up.
        end: s.
    """

    times: Array
    rows: Array
    judged: float
    end: float

    def at(self, time: float) -> Array:
        """Return the set-points (n,) that hold at a time."""
        return self.rows[np.searchsorted(self.times, time + 1e-9, side="right") - 1]


def play(world: World, points: SetPoints) -> float:
    """Play set-points; return the object's least height, m, above its start from `points.judged` on."""
    start, least, dt = world.position()[2], np.inf, world.step_seconds
    for step in range(round(points.end / dt)):
        world.step(points.at(step * dt))
        if step * dt >= points.judged:
            least = min(least, world.position()[2] - start)
    return float(least)


def pairs_apart(model: mujoco.MjModel, end: int) -> list[tuple[int, int]]:
    """Return the pairs of bodies 1 to `end` - 1 that never touch: excluded, neighbours, welded together."""
    excluded = excluded_pairs(model)
    weld, above = model.body_weldid, model.body_weldid[model.body_parentid[model.body_weldid]]

    def apart(a: int, b: int) -> bool:
        """Return True for two bodies that are not to collide."""
        near = weld[a] and weld[b] and (weld[a] == above[b] or weld[b] == above[a])
        return bool(weld[a] == weld[b] or near or frozenset((a, b)) in excluded)

    return [(a, b) for a in range(1, end) for b in range(a + 1, end) if apart(a, b)]


def mesh_file(model: mujoco.MjModel, geom: int, folder: Path) -> str:
    """Write a mesh, of which every engine takes the convex hull; return its file's path, '' for other shapes."""
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
        return ""
    path = folder / f"{geom}.obj"
    geom_mesh(model, geom).export(path)
    return str(path)
