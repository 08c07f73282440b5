"""Dropping an object on a plane until it lies still."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.objects.mjcf import add_to_spec
from dexgrasp_env.objects.parts import support_height
from dexgrasp_env.poses import frame_of_z, matrix_to_quat

if TYPE_CHECKING:
    import mujoco

    from dexgrasp_env.objects.model import ObjectModel

_TIMESTEP = 0.002
_DROP_HEIGHT = 0.005
_LONGEST = 6.0
_CHECK_EVERY = 25
_STILL_CHECKS = 4
_STILL = 2e-3
_SPIN_TIME = 0.3
_FRICTION = [0.7, 0.005, 2e-4]  # sliding, torsional m, rolling m


def drop(model: ObjectModel, ups: Array) -> tuple[Array, Array]:
    """Drop the object from orientations and return where it lies.

    Args:
        model: the object.
        ups: (n, 3) unit vectors, the world's vertical in the object frame at the start.

    Returns:
        (m, 3) the vertical in the object frame at rest, for the m <= n drops that came to rest, and (m,) the
        speed that was left, metres a second at the object's rim.
    """
    mj_model = drop_model(model)
    ends = [_drop_one(mj_model, model, up, _DROP_HEIGHT) for up in ups]
    settled = [end for end in ends if end is not None]
    if not settled:
        return np.zeros((0, 3)), np.zeros(0)
    return np.stack([up for up, _ in settled]), np.array([speed for _, speed in settled])


def stays(model: ObjectModel, up: Array, angle: float) -> bool:
    """Whether the object, put down with the vertical `up` (3,), rests within `angle` radians of it."""
    end = _drop_one(drop_model(model), model, up, 2e-4)
    return end is not None and float((end[0] * up).sum()) >= np.cos(angle)


def drop_model(model: ObjectModel) -> mujoco.MjModel:
    """Return the object alone over a plane, with a little rolling friction so that round things stop."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.timestep = _TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 1], friction=_FRICTION)
    body = spec.worldbody.add_body(name="object")
    body.add_freejoint(name="object")
    add_to_spec(spec, body, model, visual=False, condim=6)
    for geom in body.geoms:
        geom.friction = _FRICTION
    mj_model = spec.compile()
    mj_model.dof_damping[3:6] = np.trace(model.inertia) / 3 / _SPIN_TIME
    return mj_model


def _drop_one(
    mj_model: mujoco.MjModel, model: ObjectModel, up: Array, gap: float
) -> tuple[Array, float] | None:
    """Return the vertical in the object frame at rest and the speed left, or None if it never rests."""
    import mujoco

    data = mujoco.MjData(mj_model)
    data.qpos[2] = support_height(model.parts, up) + gap
    data.qpos[3:7] = _orientation(up)
    radius = 0.5 * float(model.extents.max())
    still = 0
    for _ in range(int(_LONGEST / (_TIMESTEP * _CHECK_EVERY))):
        mujoco.mj_step(mj_model, data, _CHECK_EVERY)
        speed = float(np.linalg.norm(data.qvel[:3]) + radius * np.linalg.norm(data.qvel[3:]))
        still = still + 1 if speed < _STILL and data.ncon > 0 else 0
        if still == _STILL_CHECKS:
            vertical = data.xmat[1].reshape(3, 3)[2].copy()
            return vertical / np.linalg.norm(vertical), speed
    return None


def _orientation(up: Array) -> Array:
    """A quaternion (4,) wxyz that turns `up` (3,) of the object to the world's vertical."""
    return matrix_to_quat(frame_of_z(up).T)
