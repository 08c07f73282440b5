"""One simulated scene: the part of the environment that holds MuJoCo's structures."""

import copy
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.scene.build import build_scene
from dexgrasp_env.scene.sensors import reading_columns
from dexgrasp_env.tasks.constants import SETTLE_STEPS
from dexgrasp_env.tasks.disturbance import drive_belt
from dexgrasp_env.tasks.randomisation import Variation, apply_variation
from dexgrasp_env.tasks.records import PRESSES

_WARNINGS = [mujoco.mjtWarning(i).name for i in range(int(mujoco.mjtWarning.mjNWARNING))]


def warning_mask(*names: str) -> int:
    """Return the bits of MuJoCo's warnings, which are named without their prefix."""
    return sum(1 << _WARNINGS.index(f"mjWARN_{name}") for name in names)


NO_PHYSICS = warning_mask("BADQPOS", "BADQVEL", "BADQACC", "CONTACTFULL", "CNSTRFULL")
"""Bits of the warnings of numbers not finite or far too large, and of contacts left out: what follows is no physics."""

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_PHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)


@lru_cache(maxsize=64)
def compiled_scene(model: ObjectModel, cell: Cell, belt: bool = False) -> mujoco.MjModel:
    """Compile the scene of an object once; callers copy it before they write to it."""
    return build_scene(model, cell, cameras=cell.make_cameras(), belt=belt)


class PhysicsState(NamedTuple):
    """Positions, velocities and sensors of N environments: robots of n joints, and room for k objects, else zeros.

    Attributes:
        qpos: (N, n + 7 k) positions, the target's after the robot's.
        qvel: (N, n + 6 k) velocities.
        sensors: (N, m) `sensordata`.
    """

    qpos: Array
    qvel: Array
    sensors: Array


class Physics(Protocol):
    """Physics of N environments: `Simulation` of one, `BatchPhysics` and `WarpPhysics` of many.

    Attributes:
        peak_forces: (N,) N, the largest of a finger on the object in the last control step, where scenes watch them.
    """

    peak_forces: Array

    @property
    def current(self) -> PhysicsState:
        """The present state."""

    def step(self, rows: Array, push: Array | None, which: NDArray[np.intp]) -> Index:
        """Advance environments by one control step.

        Args:
            rows: (N, frame_skip, n) set-points of the physics steps, rad.
            push: (N, 3) forces on the objects, N, or their motion (N, 6) where belts carry them; None for neither.
            which: indices of those that advance, ascending.

        Returns:
            (N,) warnings that came up, one bit each.
        """


class Simulation:
    """A compiled scene with its data; `base` stays as compiled, `model` carries the variation of the episode.

    `current` are views of the data, of one environment. After a step the sensors of neighbours hold the most of its
    physics steps.
    """

    def __init__(
        self, model: ObjectModel, cell: Cell, neighbours: Sequence[ObjectModel] = (), *, furniture: str = "",
        belt: bool = False,
    ) -> None:  # fmt: skip
        self.object, self.cell, self.neighbours, self.belt = model, cell, tuple(neighbours), belt
        self.base = (
            build_scene(model, cell, neighbours=neighbours, cameras=cell.make_cameras(), furniture=furniture)
            if neighbours
            else compiled_scene(model, cell, belt)
        )
        self.model = copy.copy(self.base)
        self.data = data = mujoco.MjData(self.model)
        self.variation = Variation()
        self.physics: Any = None
        """What advances the scene in the place of MuJoCo: a `WarpPhysics` of one environment."""
        self.columns = reading_columns(self.base, cell.robot)
        self.hull = model.solid.corners  # (V, 3) m, object frame
        self.body = int(self.base.body("object").id)
        self.touches = slice(self.base.nsensordata - len(self.neighbours), self.base.nsensordata)
        self.watches_forces, self.peak_forces = False, np.zeros(1)
        # Views into `data`, which stays where it is.
        self.current = PhysicsState(data.qpos[None], data.qvel[None], data.sensordata[None])
        self._forces = (data.qfrc_applied, data.xfrc_applied)
        self._rollout = Rollout(nthread=0)
        self._state = np.zeros((1, mujoco.mj_stateSize(self.base, _PHYSICS)))

    def vary(self, variation: Variation) -> None:
        """Write a variation into `model`; the state is lost."""
        if variation != self.variation:
            apply_variation(self.model, self.base, variation, self.data)
            self.variation = variation

    def place(self, poses: Array, joints: Array | None = None) -> None:
        """Put the robot home, or to `joints` (n,) rad, and the objects down.

        Args:
            poses: (k, 7) of these, or (7,) of one: position m and quaternion wxyz.
            joints: of the robot.
        """
        mujoco.mj_resetData(self.model, self.data)
        self.peak_forces[:] = 0.0
        robot = self.cell.robot
        begin = robot.home if joints is None else joints
        self.data.qpos[: robot.dof] = begin
        self.data.qpos[robot.dof : robot.dof + poses.size] = poses.ravel()
        self.data.ctrl[:] = begin

    def object_pose(self) -> Array:
        """Return the object's pose (7,): position m and quaternion wxyz."""
        return self.poses()[0]

    def poses(self) -> Array:
        """Return the poses of the object and its neighbours (k, 7): position m and quaternion wxyz."""
        return self.data.qpos[self.cell.robot.dof :].reshape(-1, 7)[: 1 + len(self.neighbours)].copy()

    def settle(self, steps: int = SETTLE_STEPS) -> None:
        """Advance so many physics steps to let objects come to rest; what depends on the state is current then."""
        mujoco.mj_step(self.model, self.data, steps)
        mujoco.mj_forward(self.model, self.data)

    def check_free(self) -> None:
        """Refuse a placed object that the robot is in the way of.

        Raises:
            InputError: naming the part of the robot.
        """
        mujoco.mj_forward(self.model, self.data)
        for contact in self.data.contact:
            bodies = [int(self.model.geom_bodyid[geom]) for geom in (contact.geom1, contact.geom2)]
            other = self.model.body(bodies[1] if bodies[0] == self.body else bodies[0]).name
            touched = contact.dist <= -1e-4 and self.body in bodies  # m: less is a touch that a pose may have
            if touched and other in self.cell.robot.bodies:
                raise InputError(f"object_pose: the robot's {other} is in the way: give a place free of it")

    def step(self, rows: Array, push: Array | None, which: NDArray[np.intp]) -> Index:
        """Advance one control step in one call; see `Physics`.

        Applied forces in `data` act on. A step in which MuJoCo warns is cut short.
        """
        model, data = self.model, self.data
        if self.belt and push is not None:
            drive_belt(data.qpos, data.qvel, self.cell.robot.dof, push[0])
        elif push is not None:
            data.xfrc_applied[self.body, :3] = push[0]
        if self.physics is not None:
            return self.physics.advance(self, rows)
        spec, control = CONTROL, rows
        if any(map(np.count_nonzero, self._forces)):  # quicker than numpy's any()
            forces = np.concatenate([force.ravel() for force in self._forces])
            spec |= int(mujoco.mjtState.mjSTATE_QFRC_APPLIED | mujoco.mjtState.mjSTATE_XFRC_APPLIED)
            control = np.dstack([rows, np.broadcast_to(forces, (*rows.shape[:2], len(forces)))])
        watched = self.neighbours or self.watches_forces
        readings = np.zeros((1, rows.shape[1], model.nsensordata)) if watched else None
        mujoco.mj_getState(model, data, self._state[0], _PHYSICS)
        self._rollout.rollout(
            [model], [data], self._state, control, control_spec=spec, skip_checks=True, nstep=rows.shape[1],
            initial_warmstart=data.qacc_warmstart.copy()[None], sensordata=readings,
        )  # fmt: skip
        if readings is not None:
            data.sensordata[self.touches] = readings[0, :, self.touches].max(axis=0)
        if readings is not None and self.watches_forces:
            self.peak_forces[:] = self.peaks_of(readings)
        return np.array([sum(1 << k for k, count in enumerate(data.warning.number.tolist()) if count)])

    def peaks_of(self, readings: Array) -> Array:
        """Return the largest force (N,) N of a finger on the object in sensor readings (N, steps, m)."""
        first = self.columns[PRESSES]
        forces = readings[..., first : first + 3 * len(self.cell.robot.hand.fingers)]
        return np.linalg.norm(forces.reshape(len(readings), -1, 3), axis=2).max(axis=1)

    def get_state(self) -> Array:
        """Return the full integration state."""
        state = np.zeros(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self.data, state, STATE)
        return state

    def set_state(self, state: Array) -> None:
        """Restore a state; what depends on it is computed, and the state is that of before to the last bit."""
        mujoco.mj_resetData(self.model, self.data)
        self.peak_forces[:] = 0.0
        mujoco.mj_setState(self.model, self.data, state, STATE)
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, state, STATE)


@cache
def warning_names(bits: int) -> str:
    """Return the names of the warnings, with spaces between."""
    return " ".join(name for k, name in enumerate(_WARNINGS) if bits >> k & 1)


def arm_chain(model: mujoco.MjModel, robot: Robot) -> Array:
    """Return the poses of the arm's a joints and of the palm, each in the frame before, (a + 1, 7).

    The joints turn about z. Columns are position m and quaternion wxyz.
    """
    bodies = [model.body(name) for name in (*robot.arm.bodies[1:], robot.hand.palm)]
    parent = model.body(int(bodies[-1].parentid[0])).name
    if any(model.site(robot.hand.palm).pos) or parent != robot.arm.bodies[-1]:
        raise RuntimeError("the palm frame is not that of a body on the arm's last link")
    return np.array([np.concatenate([body.pos, body.quat]) for body in bodies])
