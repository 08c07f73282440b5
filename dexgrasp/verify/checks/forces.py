"""Forces: closure, balance, cones, joint torques, and how strong they and any others could be.

The planner has a closed form of the margin, minimises over boundary normals for `load`, and solves cone programmes for
`capacity`. Here: a conic solver, rays through the cones for `load`, linear programmes on circumscribed pyramids of 96
faces, 0.05 % too wide at most, for `capacity`.
"""

import numpy as np

from dexgrasp.grasp.record import GraspRecord
from dexgrasp.physics.checks import rms_radius
from dexgrasp.physics.cones import tangent_basis
from dexgrasp.physics.conic import conic_margin, conic_residual
from dexgrasp.physics.margin import UNDEFINED
from dexgrasp.verify.checks.check import Check, at_least, at_most, claim
from dexgrasp.verify.checks.scene import Touch
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.limits import HAND_TORQUE

GRAVITY = 9.81  # m/s^2
RESIDUAL = 1e-6  # N^2, as in the paper's feasibility test
MARGIN = 1e-4
BALANCE = 1e-4  # of the weight
CONE = 1e-6  # of the friction used
TORQUE = 1e-5  # of the limit
LOAD, CAPACITY = 1e-3, 2e-3  # relative
_RATIO = 1e-3  # percent
_RAYS, _FACES = 1500, 96
_NARROWINGS, _BEST = 8, 5


def closure_checks(record: GraspRecord, touch: Touch) -> list[Check]:
    """Check wrench closure in the exact cones of the planned friction, and its claims."""
    mu, least = record.thresholds.friction, record.thresholds.closure_margin
    residual = conic_residual(touch.points, touch.normals, mu).upper
    margin = _exact_margin(touch, mu)
    checks = [
        Check("Eq. 4 residual, exact cone", residual, f"< {RESIDUAL} N^2", residual < RESIDUAL),
        at_least("closure margin, exact cone", margin, least, "", MARGIN),
        *claim(record, "closure_margin", margin, MARGIN, 1e-4),
        *claim(record, "friction", mu, 1e-12),
    ]
    return checks + _internal_claims(record, touch)


def _exact_margin(touch: Touch, mu: float) -> float:
    try:
        return conic_margin(touch.points, touch.normals, mu).value
    except InputError:  # contacts that cannot press: no closure at all
        return UNDEFINED


def _internal_claims(record: GraspRecord, touch: Touch) -> list[Check]:
    """Residual and ratios of the forces of Eq. 4, as it is in the paper (pyramids of Eq. 2)."""
    G, forces = _eq4(record, touch)
    residual = float(((G @ forces.ravel()) ** 2).sum())
    arms = np.cross(touch.points - record.arrays["centre"], forces)
    return [
        *claim(record, "closure_residual", residual, RESIDUAL, 1e-3, "N^2"),
        *claim(record, "force_ratio_percent", _ratio(forces), _RATIO, 1e-3),
        *claim(record, "torque_ratio_percent", _ratio(arms), _RATIO, 1e-3),
    ]


def _ratio(vectors: Array) -> float:
    total = float(np.linalg.norm(vectors, axis=1).sum())
    return 100.0 * float(np.linalg.norm(vectors.sum(0))) / total if total > 0.0 else 0.0


def _eq4(record: GraspRecord, touch: Touch) -> tuple[Array, Array]:
    """Return the grasp matrix of Eq. 4 and its forces (3, 3), pressing at least 1 N, by an interior-point solver."""
    from dexgrasp.physics.wrench import grasp_map, solve_wrench_qp

    points = touch.points
    answer = solve_wrench_qp(points, touch.normals, record.thresholds.friction, solver="clarabel")
    return grasp_map(points, points.mean(0), rms_radius(points)), answer.forces


def force_checks(record: GraspRecord, touch: Touch) -> list[Check]:
    """Check that the forces balance gravity within cones and joint torques, and what is claimed of them."""
    f, limits = record.arrays["forces"], record.thresholds
    weight = GRAVITY * record.mass
    G = _grasp_matrix(touch, record)
    left = G @ f.ravel() - [0.0, 0.0, weight, 0.0, 0.0, 0.0]
    press = -(f * touch.normals).sum(1)
    sliding = np.linalg.norm(f + press[:, None] * touch.normals, axis=1)
    use = float((sliding / np.maximum(limits.friction_hold * press, 1e-9)).max())
    torque = np.einsum("frj,fr->j", touch.jacobians, f)
    fraction = float((np.abs(torque) / HAND_TORQUE).max())
    return [
        at_most(
            "forces leave of gravity", float(np.linalg.norm(left[:3])) / weight, BALANCE, "of the weight"
        ),
        at_most(
            "torques leave of gravity", float(np.linalg.norm(left[3:])) / weight, BALANCE, "of the weight"
        ),
        at_least("least pressing force", float(press.min()), limits.least_press, "N", 1e-4),
        at_most("share of friction used", use, 1.0, "", CONE),
        at_most("joint torque over limit", fraction, limits.torque_share, "", TORQUE),
        *claim(record, "max_joint_torque_fraction", fraction, TORQUE),
        *claim(record, "hold_residual", float(np.linalg.norm(left)) / weight, BALANCE, 1e-3),
    ]


def strength_checks(record: GraspRecord, touch: Touch) -> list[Check]:
    """Check `load` and `capacity`, and that `holds` says what they say."""
    found = load_by_rays(record, touch)
    claimed = bool(record.certificate["holds"])
    return [
        at_least("load", found, 1.0, "", LOAD),
        *claim(record, "load", found, 0.0, LOAD),
        *claim(record, "capacity", capacity_by_programmes(record, touch), 0.0, CAPACITY),
        Check("holds as claimed", float(claimed), f"{found >= 1.0 - LOAD}", claimed == (found >= 1.0 - LOAD)),
    ]


def _grasp_matrix(touch: Touch, record: GraspRecord) -> Array:
    """(6, 9) forces -> wrench about the centre of mass, torques over the contacts' rms radius, column by column."""
    arms = (touch.points - record.arrays["centre"]) / rms_radius(touch.points)
    unit = np.eye(3)
    return np.concatenate([[[*e, *np.cross(arm, e)] for e in unit] for arm in arms]).T


def load_by_rays(record: GraspRecord, touch: Touch) -> float:
    """Return `load` (interface: 1 + D, or the share below 1) by following pushes until a force leaves its cone."""
    f, weight, mu = record.arrays["forces"], GRAVITY * record.mass, record.thresholds.friction_hold
    G = _grasp_matrix(touch, record)
    wrench = G @ f.ravel() / weight
    share, wrench[2] = float(wrench[2]), 0.0
    torque = np.abs(np.einsum("frj,fr->j", touch.jacobians, f)) / HAND_TORQUE
    if np.linalg.norm(wrench) > BALANCE or share <= 0.0 or torque.max() > 1.0 + TORQUE:
        return 0.0
    press = -(f * touch.normals).sum(1)
    if (np.linalg.norm(f + press[:, None] * touch.normals, axis=1) > (1.0 + CONE) * mu * press).any():
        return 0.0
    if share < 1.0 - BALANCE:
        return share
    solution, *_ = np.linalg.lstsq(G, -weight * np.eye(6, 3), rcond=1e-9)
    answer: Array = np.asarray(solution, dtype=np.float64)
    if np.abs(G @ answer + weight * np.eye(6, 3)).max() > 1e-6 * weight:
        return 1.0
    return 1.0 + _least_way(f, answer, touch.normals, mu)


def _least_way(f: Array, answer: Array, normals: Array, mu: float) -> float:
    """Least way, in weights, that the contacts go with any push of one weight until a force leaves its cone."""
    directions, reach = _sphere(_RAYS), 0.12
    ways = _ways(f, np.einsum("ij,kj->ki", answer, directions), normals, mu)
    best = directions[np.argsort(ways)[:_BEST]]
    least, spread = float(ways.min()), _sphere(80)
    for _ in range(_NARROWINGS):
        near = (best[:, None] + reach * spread[None]).reshape(-1, 3)
        near /= np.linalg.norm(near, axis=1, keepdims=True)
        ways = _ways(f, np.einsum("ij,kj->ki", answer, near), normals, mu)
        best, least, reach = near[np.argsort(ways)[:_BEST]], min(least, float(ways.min())), 0.4 * reach
    return least


def _ways(f: Array, moves: Array, normals: Array, mu: float) -> Array:
    """Return (K,) how often moves (K, 9) can be added to forces (3, 3) until one leaves its cone."""
    d = moves.reshape(len(moves), 3, 3)
    p0, p1 = -(f * normals).sum(-1), -(d * normals).sum(-1)
    t0, t1 = f + p0[:, None] * normals, d + p1[..., None] * normals
    a = (t1 * t1).sum(-1) - mu**2 * p1**2
    b = (t0 * t1).sum(-1) - mu**2 * p0 * p1
    c = np.minimum((t0 * t0).sum(-1) - mu**2 * p0**2, 0.0)
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    # c <= 0 within the cone, so the first way out is the positive root, written without cancellation.
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.where(b + root > 0.0, -c / (b + root), np.where(a > 0.0, (root - b) / a, np.inf))
    return np.nan_to_num(way, nan=0.0, posinf=1e9).min(1)


def _sphere(count: int) -> Array:
    """Evenly spread unit vectors (count, 3)."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    return np.stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z], 1)


def capacity_by_programmes(record: GraspRecord, touch: Touch) -> float:
    """Return `capacity` (interface: 1 + the least of 26, or the share below 1) on circumscribed pyramids."""
    gravity = np.array([0.0, 0.0, -1.0])
    down = _most(record, touch, np.zeros(3), gravity)
    if down < 1.0:
        return down
    grid = np.array(
        [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float
    )
    return 1.0 + min(_most(record, touch, gravity, d / np.linalg.norm(d)) for d in grid)


def _most(record: GraspRecord, touch: Touch, constant: Array, direction: Array) -> float:
    """Largest s such that forces within pyramids and torques balance constant + s direction, all in weights."""
    from scipy.optimize import linprog

    weight, G = GRAVITY * record.mass, _grasp_matrix(touch, record)
    t1, t2 = tangent_basis(touch.normals)
    angle = 2.0 * np.pi * np.arange(_FACES) / _FACES
    rows = np.zeros((3 * _FACES, 9))
    for i, n in enumerate(touch.normals):
        block = np.cos(angle)[:, None] * t1[i] + np.sin(angle)[:, None] * t2[i]
        rows[_FACES * i : _FACES * (i + 1), 3 * i : 3 * i + 3] = block + record.thresholds.friction_hold * n
    torque = weight * touch.jacobians.transpose(2, 0, 1).reshape(16, 9) / HAND_TORQUE[:, None]
    A = np.concatenate([rows, torque, -torque])
    b = np.r_[np.zeros(len(rows)), np.ones(32)]
    found = linprog(
        np.r_[np.zeros(9), -1.0], np.c_[A, np.zeros(len(A))], b,
        np.c_[G, np.r_[direction, np.zeros(3)]], -np.r_[constant, np.zeros(3)], bounds=(None, None), method="highs",
    )  # fmt: skip
    return float(-found.fun) if found.status == 0 else 0.0
