"""The terms of the reward, compiled; each is in [0, 1]. This module imports numba."""

import math

from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit
from dexgrasp_env.scene.constants import GRAVITY
from dexgrasp_env.tasks.constants import GRASP_FORCE, LIFT_HEIGHT
from dexgrasp_env.tasks.records import FAILURES, PHASES, PRESSES, TIPS, Record, Rules

_NEAR = 0.02  # m
_AWAY = 0.6  # m, from where there is a gain in coming nearer
_TIP = 0.016  # m, of a tip's centre from a surface that it is about to touch
_CLOSE = 0.06  # m beyond, at which a tenth is left
_TAIL = 3.0  # sqrt(1 / 0.1 - 1)
_FRICTION = 1  # column of the variation
_NO_FAILURE = FAILURES.index("")
_NO_PHASE, _OVER = PHASES.index("none"), PHASES.index("over")


@njit
def length(x: float, y: float, z: float) -> float:
    """Return the length of a vector."""
    return math.sqrt(x * x + y * y + z * z)


@njit
def reward_terms(e: Record, pose: Array, R: tuple[float, ...], s: Array, rules: Rules, terms: Array) -> None:
    """Write the terms of the dense reward: (7,), of `settings.WEIGHTS`.

    Args:
        e: the episode's record, brought up to date.
        pose: of the object, (7,) m and quaternion wxyz.
        R: its rotation, row by row.
        s: `sensordata`.
        rules: of the environment.
        terms: out.
    """
    for k in range(len(terms)):
        terms[k] = 0.0
    terms[6] = e.solved
    if e.failure != _NO_FAILURE:
        return
    far, near, fingers = 0.0, 0.0, len(rules.grasp) - 1
    x = y = z = 0.0  # between the thumb's tip and the middle of the others
    for k in range(fingers + 1):
        share = 0.5 if k == 0 else 0.5 / fingers
        tip = rules.at[TIPS] + 3 * rules.grasp[k]
        a, b, c = s[tip], s[tip + 1], s[tip + 2]
        x, y, z = x + share * a, y + share * b, z + share * c
        distance = _distance_to_box(e, pose, R, a, b, c)
        far += share * max(1.0 - max(distance - _NEAR, 0.0) / _AWAY, 0.0)
        near += share * _nearness(distance, _TIP, _CLOSE)
    terms[0] = far
    terms[1] = near * _nearness(_distance_to_box(e, pose, R, x, y, z), 0.0, _CLOSE)
    force = _opposed_force(s, rules)
    terms[2] = min(force / GRASP_FORCE, 1.0)
    borne = e.mass * GRAVITY / (2.0 * e.variation[_FRICTION])
    terms[3] = min(force / max(borne, GRASP_FORCE), 1.0)
    terms[4] = min(max(e.height / LIFT_HEIGHT, 0.0), 1.0) * terms[2]
    if e.phase == _NO_PHASE or e.phase == _OVER:
        terms[5] = e.grasps / rules.hold


@njit
def _opposed_force(s: Array, rules: Rules) -> float:
    """Force of the thumb or of the other fingers together, the lesser, as far as the two are opposed, N."""
    thumb = rules.at[PRESSES] + 3 * rules.grasp[0]
    a, b, c = s[thumb], s[thumb + 1], s[thumb + 2]
    x = y = z = 0.0
    for finger in range(rules.fingers):
        if finger != rules.grasp[0]:
            first = rules.at[PRESSES] + 3 * finger
            x, y, z = x + s[first], y + s[first + 1], z + s[first + 2]
    one, other = length(a, b, c), length(x, y, z)
    if one == 0.0 or other == 0.0:
        return 0.0
    return min(one, other) * max(-(a * x + b * y + c * z) / (one * other), 0.0)


@njit
def _distance_to_box(e: Record, pose: Array, R: tuple[float, ...], px: float, py: float, pz: float) -> float:
    """Distance of a point to the object's box, m: as large as the mesh's, but about the centre of mass, not its own."""
    a, b, c = px - pose[0], py - pose[1], pz - pose[2]
    h = e.half_extents
    x = max(abs(a * R[0] + b * R[3] + c * R[6]) - h[0], 0.0)
    y = max(abs(a * R[1] + b * R[4] + c * R[7]) - h[1], 0.0)
    z = max(abs(a * R[2] + b * R[5] + c * R[8]) - h[2], 0.0)
    return length(x, y, z)


@njit
def _nearness(distance: float, near: float, far: float) -> float:
    """1 up to `near`, 0.1 at `far` beyond, with a long tail; m.

    This is `dm_control.utils.rewards.tolerance(distance, (0, near), far, "long_tail")`; a test holds the two together.
    """
    x = _TAIL * max(distance - near, 0.0) / far
    return 1.0 / (x * x + 1.0)
