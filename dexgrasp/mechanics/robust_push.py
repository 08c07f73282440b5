"""The largest push that planned forces bear, whatever its direction, and the plane of each cone that says so.

A push of size t in any direction u moves the force of contact i by -t answers_i u. It stays in its cone for all u if
a . f_i >= t |answers_i^T a| for every plane that touches the cone, a its inward normal: t is the least ratio of both,
found by a scan of the planes and bisection of every minimum. Of a soft finger, whose friction has a third part, the
share of that part is scanned and bisected besides.
"""

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import leaf

_SCAN = 48  # angles at which the worst plane of a cone is looked for first
_SHARP = 1e-6  # rad to which it is found
_TILTS = 24  # shares of friction that turns, of which each is scanned so


Friction = tuple[float, float, float]
"""Direction of friction: in both tangents, and about the normal."""
Plane = tuple[float, float, float, float]
"""Inward normal of a plane; the fourth counts where contacts are soft."""


@leaf
def borne_push(cone: Array, answers: Array, force: Array) -> tuple[float, Friction]:
    """Return the t that one force bears, and the direction of friction at the plane that says so.

    Args:
        cone: (3, 3) -friction x normal, and two tangents.
        answers: (c, 3) N, to a push of 1 along each axis.
        force: (c,) N.
    """
    if len(force) == 3:
        least, worst = _around(cone, answers, force, 0.0)
        return least, (np.cos(worst), np.sin(worst), 0.0)
    step, least, worst, tilt = np.pi / _TILTS, np.inf, 0.0, 0.0
    for k in range(_TILTS + 1):
        value, angle = _around(cone, answers, force, k * step - 0.5 * np.pi)
        if value < least:
            least, worst, tilt = value, angle, k * step - 0.5 * np.pi
    while step > _SHARP:
        step *= 0.5
        for side in (tilt - step, tilt + step):
            value, angle = _around(cone, answers, force, side)
            if value < least:
                least, worst, tilt = value, angle, side
    return least, (np.cos(tilt) * np.cos(worst), np.cos(tilt) * np.sin(worst), np.sin(tilt))


@leaf
def borne_pushes(cones: Array, answers: Array, forces: Array) -> float:
    """Return the t that all forces (N, c) bear, by cones (N, 3, 3) and answers (N, c, 3) as `borne_push` takes them."""
    least = np.inf
    for i in range(len(forces)):
        least = min(least, borne_push(cones[i], answers[i], forces[i])[0])
    return least


@leaf
def _around(cone: Array, answers: Array, force: Array, tilt: float) -> tuple[float, float]:
    """Return the least ratio where friction turns by its share sin(tilt), and that plane's angle.

    There may be two such planes that say nearly the same, so every minimum of the scan is followed to its end.
    """
    step, least, worst = 2.0 * np.pi / _SCAN, np.inf, 0.0
    before = _ratio(cone, answers, force, -2.0 * step, tilt)
    here = _ratio(cone, answers, force, -step, tilt)
    for k in range(_SCAN):
        after = _ratio(cone, answers, force, k * step, tilt)
        if here <= min(before, after):
            value, angle, width = here, (k - 1) * step, step
            while width > _SHARP:
                width *= 0.5
                for side in (angle - width, angle + width):
                    other = _ratio(cone, answers, force, side, tilt)
                    if other < value:
                        value, angle = other, side
            if value < least:
                least, worst = value, angle
        before, here = here, after
    return least, worst


@leaf
def _ratio(cone: Array, answers: Array, force: Array, angle: float, tilt: float) -> float:
    """Return how far a force is from a plane over what a unit of t moves it towards there."""
    plane = touching_plane(cone, (np.cos(tilt) * np.cos(angle), np.cos(tilt) * np.sin(angle), np.sin(tilt)))
    return along(plane, force) / max(asked(plane, answers), 1e-12)


@leaf
def touching_plane(cone: Array, friction: Friction) -> Plane:
    """Return the plane that touches a cone where friction points in a direction of length 1."""
    u, v, turn = friction
    return (
        cone[0, 0] - u * cone[1, 0] - v * cone[2, 0],
        cone[0, 1] - u * cone[1, 1] - v * cone[2, 1],
        cone[0, 2] - u * cone[1, 2] - v * cone[2, 2],
        -turn,
    )


@leaf
def along(plane: Plane, force: Array) -> float:
    """Return the part of a force (c,) along a plane's normal."""
    part = plane[0] * force[0] + plane[1] * force[1] + plane[2] * force[2]
    if len(force) == 4:
        part += plane[3] * force[3]
    return part


@leaf
def each_along(plane: Plane, forces: Array, k: int) -> float:
    """The same of the k-th of forces (c, n)."""
    part = plane[0] * forces[0, k] + plane[1] * forces[1, k] + plane[2] * forces[2, k]
    if len(forces) == 4:
        part += plane[3] * forces[3, k]
    return part


@leaf
def asked(plane: Plane, answers: Array) -> float:
    """Return how far the worst push of 1 moves a force, by its answers, against a plane."""
    total = 0.0
    for k in range(3):
        total += each_along(plane, answers, k) ** 2
    return np.sqrt(total)
