"""Domain randomisation: object, contact, servos and sensors, written into a compiled model."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import mujoco
import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.scene.build import pair_friction
from dexgrasp_env.scene.constants import CONTROL_PERIOD, FRICTION, TIMESTEP
from dexgrasp_env.valid import Rule, number, pair, read


@dataclass(frozen=True)
class Variation:
    """One draw of the domain randomisation.

    Attributes:
        mass: factor on the object's mass.
        friction: sliding coefficient of every contact.
        size: factor on the object's lengths.
        gain: factor on the servos' stiffness.
        latency: s by which set-points reach the servos late, in whole physics steps.
        joint_noise: rad, standard deviation of the measured joint positions.
    """

    mass: float = 1.0
    friction: float = FRICTION
    size: float = 1.0
    gain: float = 1.0
    latency: float = 0.0
    joint_noise: float = 0.0


Range = tuple[float, float] | None
Rngs = Sequence[Generator | None]
"""Random generators of episodes; None for one whose sensors are not read."""


@dataclass(frozen=True)
class Randomisation:
    """Ranges drawn from at every reset; None leaves a quantity as it is. See `Variation` for the meanings.

    Attributes:
        mass: range of the factor on the object's mass.
        friction: range of the coefficient.
        size: range of the factor on the object's lengths (mass follows with its cube before `mass` applies).
        gain: range of the factor on the servos' stiffness.
        latency: range, s, up to 0.05.
        joint_noise: range, rad.
    """

    mass: Annotated[Range, pair(number(ge=1e-3, le=1e3))] = None
    friction: Annotated[Range, pair(number(ge=1e-3, le=10))] = None
    size: Annotated[Range, pair(number(ge=1e-2, le=1e2))] = None
    gain: Annotated[Range, pair(number(ge=1e-2, le=1e2))] = None
    latency: Annotated[Range, pair(number(ge=0, le=CONTROL_PERIOD))] = None
    joint_noise: Annotated[Range, pair(number(ge=0, le=1))] = None

    def sample(self, rng: Generator, mass: float, friction: float) -> Variation:
        """Draw a variation.

        Args:
            rng: three numbers are always taken from it, and one for each range of servos and sensors.
            mass: factor that the drawn one multiplies.
            friction: the coefficient where none is drawn.
        """
        u = rng.random(3)

        def draw(bounds: Range, u: float, default: float) -> float:
            """Return the value at `u` in [0, 1] of a range, the default where there is none."""
            return default if bounds is None else bounds[0] + (bounds[1] - bounds[0]) * u

        late = {
            name: draw(bounds, rng.random(), 0.0)
            for name in ("gain", "latency", "joint_noise")
            if (bounds := getattr(self, name)) is not None
        }
        if "latency" in late:
            late["latency"] = round(late["latency"] / TIMESTEP) * TIMESTEP
        return Variation(
            mass * draw(self.mass, u[0], 1.0),
            draw(self.friction, u[1], friction),
            draw(self.size, u[2], 1.0),
            **late,
        )

    def draw_joint_noise(self, variations: Array, joints: int, rngs: Rngs) -> Array:
        """Draw the noise (N, joints) rad of joint position sensors; (N, 0) where there is none.

        Args:
            variations: (N, 6), fields of `Variation`.
            joints: of the robot.
            rngs: of the N episodes.
        """
        if self.joint_noise is None:
            return np.empty((len(variations), 0))
        drawn = [np.zeros(joints) if rng is None else rng.standard_normal(joints) for rng in rngs]
        return variations[:, 5:] * np.array(drawn)


def ranges(drawn: Sequence[tuple[str, float, float]]) -> Fields:
    """Return what `gym.make` takes as `randomisation`.

    Raises:
        InputError: for a quantity that is there twice.
    """
    found = {name: tuple(ends) for name, *ends in drawn}
    if len(found) < len(drawn):
        raise InputError("randomise names a quantity twice: valid is one range of each")
    return found


def _drawn(word: str) -> tuple[str, float, float]:
    name, _, ends = word.partition("=")
    low, _, high = ends.partition(":")
    return name, float(low), float(high)


def _validate(drawn: Any) -> Any:
    read(Randomisation, ranges([drawn]), "randomise")
    return drawn


_DRAWN = Rule("NAME=LOW:HIGH", _validate, _drawn)
Draws = tuple[Annotated[tuple[str, float, float], _DRAWN, "NAME=LOW:HIGH"], ...]
"""Quantities and the ranges that they are drawn from, as an option states them."""


def apply_variation(
    model: mujoco.MjModel, base: mujoco.MjModel, variation: Variation, data: mujoco.MjData
) -> None:
    """Write a variation of the compiled model `base` into `model`, a copy of it; nothing is compiled.

    What `data` holds is lost: to make some takes longer than all else here.
    """
    contact = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
    model.geom_friction[contact, 0] = variation.friction
    model.pair_friction[:] = pair_friction(base, variation.friction)
    body, size = model.body("object").id, variation.size
    # Geoms, meshes and bounding volumes of the object scale about its centre of mass.
    geoms = np.flatnonzero(model.geom_bodyid == body)
    for field in ("geom_size", "geom_pos", "geom_rbound", "geom_aabb"):
        getattr(model, field)[geoms] = getattr(base, field)[geoms] * size
    _scale_boxes(model, base, int(model.body_bvhadr[body]), int(model.body_bvhnum[body]), size)
    for mesh in {
        int(model.geom_dataid[g]) for g in geoms if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH
    }:
        rows = slice(model.mesh_vertadr[mesh], model.mesh_vertadr[mesh] + model.mesh_vertnum[mesh])
        model.mesh_vert[rows] = base.mesh_vert[rows] * size
        model.mesh_pos[mesh] = base.mesh_pos[mesh] * size
        _scale_boxes(model, base, int(model.mesh_bvhadr[mesh]), int(model.mesh_bvhnum[mesh]), size)
    factor = variation.mass * size**3
    model.body_mass[body] = base.body_mass[body] * factor
    model.body_inertia[body] = base.body_inertia[body] * factor * size**2
    model.actuator_gainprm[:, 0] = base.actuator_gainprm[:, 0] * variation.gain
    model.actuator_biasprm[:, 1] = base.actuator_biasprm[:, 1] * variation.gain
    mujoco.mj_setConst(model, data)


def _scale_boxes(model: mujoco.MjModel, base: mujoco.MjModel, first: int, number: int, size: float) -> None:
    if first >= 0:
        rows = slice(first, first + number)
        model.bvh_aabb[rows] = base.bvh_aabb[rows] * size
