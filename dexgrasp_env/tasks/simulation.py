"""One simulation of the scene: the part of the environment that holds MuJoCo's structures."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.robot.limits import HOME
from dexgrasp_env.scene.constants import CONTROL_STEPS
from dexgrasp_env.scene.sensors import SensorIndex
from dexgrasp_env.tasks.constants import SETTLE_STEPS
from dexgrasp_env.tasks.randomisation import Variation, apply_variation
from dexgrasp_env.tasks.state import LiftState, ObjectConstants

_WARNINGS = [mujoco.mjtWarning(i).name for i in range(int(mujoco.mjtWarning.mjNWARNING))]
BAD_NUMBERS = frozenset({"mjWARN_BADQPOS", "mjWARN_BADQVEL", "mjWARN_BADQACC"})
"""Warnings about numbers that are not finite or far too large: what follows them is no physics."""

_FRACTIONS = np.arange(1, CONTROL_STEPS + 1)[:, None] / CONTROL_STEPS


@dataclass
class Simulation:
    """A compiled scene with its data; `base` stays as compiled, `model` carries the variation of the episode."""

    object: ObjectModel
    base: mujoco.MjModel
    model: mujoco.MjModel
    data: mujoco.MjData
    sensors: SensorIndex
    constants: ObjectConstants
    variation: Variation
    targets: Array

    @classmethod
    def of(cls, model: ObjectModel, compiled: mujoco.MjModel) -> "Simulation":
        """Set up a simulation of a compiled scene; the compiled model itself is never written to."""
        own = copy.copy(compiled)
        constants = ObjectConstants(np.asarray(model.mesh.convex_hull.vertices), model.extents, model.mass)
        return cls(
            model,
            compiled,
            own,
            mujoco.MjData(own),
            SensorIndex.of(compiled),
            constants,
            Variation(),
            HOME.copy(),
        )

    def reset(self, object_pose: Array, variation: Variation) -> None:
        """Put robot and object back, apply the variation, let the object settle for 0.2 s.

        Args:
            object_pose: (7,) position m and quaternion wxyz.
            variation: mass, friction and size of this episode.
        """
        if variation != self.variation:
            apply_variation(self.model, self.base, variation)
            self.variation = variation
            scale = variation.size
            base = self.object
            self.constants = ObjectConstants(
                np.asarray(base.mesh.convex_hull.vertices) * scale, base.extents * scale,
                base.mass * variation.mass * scale**3,
            )  # fmt: skip
        data = self.data
        mujoco.mj_resetData(self.model, data)
        data.qpos[:23] = HOME
        data.qpos[23:30] = object_pose
        self.targets = HOME.copy()
        data.ctrl[:] = self.targets
        for _ in range(SETTLE_STEPS):
            mujoco.mj_step(self.model, data)
        mujoco.mj_forward(self.model, data)

    def step(self, targets: Array) -> None:
        """Advance one control step while the set-points move evenly from the last ones to `targets` (23,) rad."""
        model, data, ctrl, step = self.model, self.data, self.data.ctrl, mujoco.mj_step
        for row in ramp(self.targets, targets):
            ctrl[:] = row
            step(model, data)
        self.targets = targets

    @property
    def state(self) -> LiftState:
        """The present state; its arrays are views that the next step overwrites."""
        return LiftState(self.data.qpos, self.data.qvel, self.data.sensordata, self.targets, self.sensors)

    @property
    def warnings(self) -> list[str]:
        """Names of the warnings that MuJoCo has raised since reset."""
        numbers = self.data.warning.number.tolist()
        return (
            [name for name, number in zip(_WARNINGS, numbers, strict=True) if number] if any(numbers) else []
        )


def ramp(start: Array, end: Array) -> Array:
    """Return the set-points (25, 23) of the physics steps in a control step, evenly from `start` to exactly `end`."""
    rows = start + _FRACTIONS * (end - start)
    rows[-1] = end
    return rows


class PalmJacobian:
    """Jacobian of the palm at given arm set-points, on scratch data: the state of the simulation is not touched."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._site = model.site("palm").id
        self._jacobian = np.zeros((6, model.nv))

    def __call__(self, targets: Array) -> Array:
        """Return (6, 7): rows linear m and angular rad in the robot base frame, columns the arm's joints."""
        self._data.qpos[:23] = targets
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_jacSite(self._model, self._data, self._jacobian[:3], self._jacobian[3:], self._site)
        return self._jacobian[:, :7].copy()
