"""Checks of forces: closure, balance, cones, joint torques, and the pushes that they and any others bear.

The planner has a closed form of the margin, minimises over boundary normals for `load`, and cuts planes for `capacity`.
Here: cone programmes of clarabel, and for `load` rays through the cones, many directions at once.
"""

import numpy as np

from dexgrasp.grasp.verify.case import Case, ForceBalance
from dexgrasp.grasp.verify.check import Check, at_least, at_most, claim
from dexgrasp.grasp.verify.cones import (
    conic_margin,
    conic_residual,
    largest_push,
    pyramid_forces,
    slides,
    wrench_map,
)
from dexgrasp_env.arrays import Array, cube_directions, fibonacci_directions, unit

RESIDUAL = 1e-6  # N^2, as in the paper's feasibility test
MARGIN = 1e-4
BALANCE = 1e-4  # of the weight
CONE = 1e-6  # of the friction used
TORQUE = 1e-5  # of the limit
LOAD, CAPACITY = 1e-3, 2e-3  # relative


def closure_checks(case: Case) -> list[Check]:
    """Check wrench closure in the exact cones of the planned friction, and its claims."""
    points, normals, mu = case.touch.points, case.touch.normals, case.limits.friction
    residual = conic_residual(points, normals, mu)
    found = conic_margin(points, normals, mu, case.robot.hand.torsion)
    margin = -1e3 if found is None else found  # stands for a margin that was not found
    forces = pyramid_forces(points, normals, mu)  # of Eq. 4 as it is in the paper
    wrench = wrench_map(points, points.mean(0)) @ forces.ravel()
    arms = np.cross(points - case.record.centre, forces)
    ratio = 1e-3  # percent
    return [
        Check("Eq. 4 residual, exact cone", residual, f"< {RESIDUAL} N^2", residual < RESIDUAL),
        at_least("closure margin, exact cone", margin, case.limits.closure_margin, "", MARGIN),
        *claim(case, "closure_margin", margin, MARGIN, 1e-4),
        *claim(case, "friction", mu, 1e-12),
        *claim(case, "closure_residual", wrench @ wrench, RESIDUAL, 1e-3, "N^2"),
        *claim(case, "force_ratio_percent", _ratio(forces), ratio, 1e-3),
        *claim(case, "torque_ratio_percent", _ratio(arms), ratio, 1e-3),
    ]


def _ratio(vectors: Array) -> float:
    """|sum of vectors| in percent of the sum of their lengths."""
    total = np.linalg.norm(vectors, axis=1).sum()
    return float(100.0 * np.linalg.norm(vectors.sum(0)) / total) if total > 0.0 else 0.0


def force_checks(case: Case) -> list[Check]:
    """Check that the forces balance gravity within cones and joint torques, and what is claimed of them."""
    hold, limits = case.hold, case.limits
    kinds = (("forces", hold.left[:3]), ("torques", hold.left[3:]))
    return [
        *(at_most(f"{kind} leave of gravity", np.linalg.norm(left), BALANCE, "of the weight") for kind, left in kinds),
        at_least("least pressing force", hold.press.min(), limits.least_press, "N", 1e-4),
        at_most("share of friction used", hold.friction_use, 1.0, "", CONE),
        at_most("joint torque over limit", hold.torque_use, limits.torque_share, "", TORQUE),
        *_stop_checks(case),
        *claim(case, "max_joint_torque_fraction", hold.torque_use, TORQUE),
        *claim(case, "hold_residual", np.linalg.norm(hold.left), BALANCE, 1e-3),
    ]  # fmt: skip


def _stop_checks(case: Case) -> list[Check]:
    """Check that a tendon pulls no joint off the stop that it stands on."""
    case.scene.place(case.record.q)
    J = case.scene.jacobians(case.touch.points, case.touch.normals, driven=False)
    torque = np.einsum("frj,fr->j", J, case.record.forces)
    own = dict(zip(case.robot.hand.joints.names, torque, strict=True))
    left = [
        own[joint] - coef * own[tendon.joints[-1]]
        for tendon in case.robot.hand.tendons
        for joint, coef in zip(tendon.joints[:-1], tendon.coefs, strict=False)
    ]
    return [at_least("torque on the stops of tendons", min(left), 0.0, "Nm", TORQUE)] if left else []


def strength_checks(case: Case) -> list[Check]:
    """Check `load` and `capacity`, and that `holds` says what they say."""
    capacity, claimed = _capacity(case.hold), case.record.certificate.holds
    found = min(_load(case.hold), capacity)
    bears = found >= 1.0 - LOAD
    return [
        at_least("load", found, 1.0, "", LOAD),
        *claim(case, "load", found, 0.0, LOAD),
        *claim(case, "capacity", capacity, 0.0, CAPACITY),
        Check("holds as claimed", float(claimed), str(bears), claimed == bears),
    ]


def _load(hold: ForceBalance) -> float:
    """Return 1 + D, or the share below 1, by following pushes until a force leaves its cone, with either answer."""
    share = float(hold.wrench[2])
    unbalanced = np.linalg.norm(np.delete(hold.wrench, 2)) > BALANCE or share <= 0.0
    if unbalanced or hold.torque_use > 1.0 + TORQUE or not 0.0 <= hold.friction_use <= 1.0 + CONE:
        return 0.0
    if share < 1.0 - BALANCE:
        return share
    return 1.0 + min(_way(hold, np.eye(hold.forces.size)), _way(hold, hold.compliance))


def _way(hold: ForceBalance, compliance: Array) -> float:
    """Return the least way of a push where contacts give way by `compliance` (c N, c N), by Lagrange multipliers."""
    wanted, n = -hold.weight * np.eye(6, 3), len(compliance)
    system = np.block([[compliance / np.abs(compliance).max(), hold.G.T], [hold.G, np.zeros((6, 6))]])
    answer = np.linalg.lstsq(system, np.concatenate([np.zeros((n, 3)), wanted]), rcond=1e-12)[0][:n]
    if np.abs(hold.G @ answer - wanted).max() > 1e-6 * hold.weight:
        return 0.0
    return least_way(hold.forces, answer, hold.normals, hold.mu)


def _capacity(hold: ForceBalance) -> float:
    """Return `capacity` (interface: 1 + the least of 26, or the share below 1); 0 where a programme is not solved."""

    def most(constant: Array, direction: Array) -> float:
        """Return the largest push along a direction beside a constant one, weights; 0 where there is none."""
        push = hold.weight * np.r_[constant, np.zeros(3)], hold.weight * np.r_[direction, np.zeros(3)]
        found = largest_push(hold.G, hold.normals, hold.mu, hold.torques, push)
        return 0.0 if found is None else found

    gravity = np.array([0.0, 0.0, -1.0])
    down = most(np.zeros(3), gravity)
    if down < 1.0:
        return down
    return 1.0 + min(most(gravity, direction) for direction in cube_directions())


def least_way(forces: Array, answer: Array, normals: Array, mu: float) -> float:
    """Return the least way that forces go with a push, in any direction, until one leaves its cone.

    Args:
        forces: (N, c) N, within their cones.
        answer: (c N, 3), what a push of one unit along x, y, z adds to them.
        normals: (N, 3) unit, out of the object.
        mu: friction coefficient.

    Returns:
        The way in units of the push.
    """
    directions, reach, least = fibonacci_directions(1500), 0.12, np.inf
    spread = fibonacci_directions(80)
    for _ in range(9):  # each time closer about the best
        ways = _ways(forces, np.einsum("ij,kj->ki", answer, directions), normals, mu)
        least = min(least, float(ways.min()))
        best = directions[np.argsort(ways)[:5]]
        directions = unit((best[:, None] + reach * spread[None]).reshape(-1, 3))
        reach *= 0.4
    return least


def _ways(forces: Array, moves: Array, normals: Array, mu: float) -> Array:
    """Return (K,) how often moves (K, c N) can be added to forces (N, c) until one leaves its cone, by halving."""
    moves = moves.reshape(-1, *forces.shape)
    low, high = np.zeros(len(moves)), np.full(len(moves), 1e3)  # no hand bears as many
    for _ in range(40):
        middle = 0.5 * (low + high)
        press, sliding = slides(forces + middle[:, None, None] * moves, normals)
        inside = (sliding <= mu * press).all(1)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low
