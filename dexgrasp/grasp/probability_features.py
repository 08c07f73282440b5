"""Features of the probability that a grasp holds: figures of its file alone, at a friction and a mass.

A grasp is as good as it bears what was not seen right. So the planned forces are put on a surface that lies elsewhere:
in each of 64 fixed draws every contact, and the centre of mass, is moved by a few millimetres, normals are those of the
hull there and tilted a little, and what the object weighs more or less than assumed is answered by the least forces.
What push is borne in weights, D of `load`, is asked of all of them.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from dexgrasp.grasp.record import GraspRecord
from dexgrasp_env.arrays import Array, cube_directions, unit
from dexgrasp_env.scene.constants import GRAVITY

_SIDES = cube_directions()


class Draws(NamedTuple):
    """Surfaces that the object may have: contacts (K, N, 3) m, normals out of it (K, N, 3), centres (K, 3) m."""

    points: Array
    normals: Array
    centres: Array


def features_of(record: GraspRecord, friction: float, mass: float, guessed: float) -> dict[str, float]:
    """Return the figures of a grasp, by name.

    Args:
        record: the grasp.
        friction: coefficient of the surfaces that meet.
        mass: kg of the object.
        guessed: m, mean error expected of the surface at the contacts where no camera saw it; else 0.
    """
    weight, forces = GRAVITY * mass, record.forces[:, :3]
    exact = Draws(record.points[None], record.normals[None], record.centre[None])
    held, borne = _borne(forces, exact, weight, friction)
    # m of contacts and centre
    around = _borne(forces, _drawn(record, np.hypot(0.003, guessed)), weight, friction)[1]
    planned = held[0]
    press = -(planned * record.normals).sum(1)
    slide = np.linalg.norm(planned + press[:, None] * record.normals, axis=1)
    return {
        "friction": friction,
        "mass": mass,
        "guessed": guessed,
        "borne": float(borne[0]),
        "borne_low": float(np.quantile(around, 0.1)),
        "slips": float((around < 0.0).mean()),
        "slips_pushed": float((around < 1.0).mean()),
        "friction_use": float(np.clip(slide / np.maximum(friction * press, 1e-6), 0.0, 4.0).max()),
        "closure_margin": record.certificate.closure_margin,
    }


def _nearest(parts: Iterable[Array], points: Array) -> Array:
    """Return the normals (..., 3) of the faces that points (..., 3) m are farthest out of, of the nearest part."""
    from scipy.spatial import ConvexHull

    faces = [ConvexHull(part).equations for part in parts]
    out = [points @ part[:, :3].T + part[:, 3] for part in faces]
    normals = np.stack([part[values.argmax(-1), :3] for part, values in zip(faces, out, strict=True)])
    first = np.stack([values.max(-1) for values in out]).argmin(0)
    return np.take_along_axis(normals, first[None, ..., None], 0)[0]


def _drawn(record: GraspRecord, place: float) -> Draws:
    draws = 64
    rng, shape = np.random.default_rng(0), (draws, *record.points.shape)
    moved = place * rng.standard_normal(shape)
    tips = record.points + record.thresholds.tip_radius * record.normals
    # rad of normals: standard deviations
    normals = unit(_nearest(record.parts, tips + moved) + 0.07 * rng.standard_normal(shape))
    return Draws(record.points + moved, normals, record.centre + place * rng.standard_normal((draws, 3)))


def _answers(draws: Draws) -> tuple[Array, Array]:
    """Return the grasp maps (K, 6, 3 N), and the least forces that answer a wrench (K, 3 N, 6)."""
    arms = draws.points - draws.centres[:, None]
    x, y, z = np.moveaxis(arms / np.sqrt((arms[0] ** 2).sum(-1).mean()), -1, 0)
    o = np.zeros_like(x)
    cross = np.stack([np.stack(row, -1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))], -2)
    whole = np.concatenate([np.broadcast_to(np.eye(3), cross.shape), cross], -2)
    G = np.moveaxis(whole, 1, 2).reshape(len(arms), 6, -1)
    return G, np.linalg.pinv(G, rcond=1e-6)


def _borne(forces: Array, draws: Draws, weight: float, friction: float) -> tuple[Array, Array]:
    """Return the forces that bear the weight in each draw, and the push that is borne in every direction.

    The forces (K, N, 3) N are as near the planned ones (N, 3) as can be; the push (K,) is in weights, less than 0 where
    forces slide already.
    """
    G, answer = _answers(draws)
    left = weight * np.eye(6)[2] - G @ forces.ravel()
    held = (forces + (answer @ left[..., None]).reshape(-1, *forces.shape))[:, None]
    change = -weight * (answer[..., :3] @ _SIDES.T).transpose(0, 2, 1).reshape(len(held), -1, *forces.shape)
    n = draws.normals[:, None]
    press, gain = -(held * n).sum(-1), -(change * n).sum(-1)
    slide, drift = held + press[..., None] * n, change + gain[..., None] * n
    a = (drift**2).sum(-1) - (friction * gain) ** 2
    b = (slide * drift).sum(-1) - friction**2 * press * gain
    c = (slide**2).sum(-1) - (friction * press) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        # The first push that leaves the cone: of a d^2 + 2 b d + c, which is negative inside.
        first = np.where(b * b < a * c, np.inf, -c / (b + np.sqrt(np.maximum(b * b - a * c, 0.0))))
    most = 8.0  # weights: larger pushes tell nothing more
    first = np.where((first > 0.0) & np.isfinite(first), first, most).min((-1, -2))
    short = (friction * press - np.linalg.norm(slide, axis=-1)).min((-1, -2)) / weight
    return held[:, 0], np.clip(np.where(short < 0.0, short, first), -2.0, most)
