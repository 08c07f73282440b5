"""Builder of the certificate of a grasp, from configuration, forces and object alone."""

import numpy as np

from dexgrasp.grasp.certificate import Certificate
from dexgrasp.mechanics.contacts import Contacts
from dexgrasp.mechanics.kinematics.clearance import NEIGHBOUR, SELF, TABLE, clearances
from dexgrasp.mechanics.margin import margins
from dexgrasp.mechanics.strength import hold_residual, load_of, torque_fraction
from dexgrasp.mechanics.wrench import solve_wrench_qp, wrench_ratios
from dexgrasp.planning.settings import GraspProblem
from dexgrasp_env.arrays import Array, Index, Mask

FAR = 0.02  # m: clearances beyond are not measured


def certificate_of(
    q: Array, forces: Array, contacts: Contacts, distances: Array, problem: GraspProblem
) -> Certificate:
    """Return what is true of a grasp, however its configuration and forces were found, but for `capacity`.

    Args:
        q: (n,) rad.
        forces: (N, c) N on the object.
        contacts, distances: `holding.contacts_of` the configuration, with the friction that it is to hold with.
        problem: object and robot; of the settings friction coefficients and tip radius.
    """
    target, tree, settings = problem.target, problem.tree, problem.settings
    internal = solve_wrench_qp(contacts.points, contacts.normals, settings.friction)
    force_ratio, torque_ratio = wrench_ratios(contacts.points, internal.forces, target.centre)
    load = load_of(contacts, forces, tree.stiffness)
    return Certificate(
        distances_cm=tuple(float(d) for d in 100.0 * (distances - settings.tip_radius)),
        force_ratio_percent=force_ratio,
        torque_ratio_percent=torque_ratio,
        closure_residual=float(internal.residual),
        closure_margin=float(
            margins(contacts.points[None], contacts.normals[None], settings.friction, tree.model)[0]
        ),
        min_clearance_m=least_clearance(q, problem),
        joint_limit_margin_rad=float(np.minimum(q - tree.lower, tree.upper - q).min()),
        max_joint_torque_fraction=torque_fraction(contacts, forces),
        holds=load >= 1.0,
        hold_residual=hold_residual(contacts, forces),
        mass=target.mass,
        load=load,
        capacity=float("nan"),
        friction=settings.friction,
    )


def least_clearance(q: Array, problem: GraspProblem) -> float:
    """Return the least clearance from object, table and itself, m, at most `FAR`."""
    values, labels = clearances(q, problem.tree, problem.world, FAR, True)
    return float(min(values[labels[:, 0] != NEIGHBOUR], default=FAR))


def too_near(q: Array, problem: GraspProblem, least: float) -> Index:
    """Return the labels (K, 3), kind and bodies, of clearances below `least` m, the tips' from the object too; of
    neighbours, below 2 mm.

    Beside a low object tips may be as near the table as they grasp; fingers that stand close at home, and their first
    links, may be as close to each other as in a grasp.
    """
    values, labels = clearances(q, problem.tree, problem.world, least, False)
    # 2 mm between the hand, closed or open, and what stands around the object.
    needed = np.where(labels[:, 0] == NEIGHBOUR, min(0.002, least), least)
    if problem.settings.is_low(problem.target.top):
        needed[labels[:, 0] == TABLE] = problem.settings.off_table(problem.target.top)
    if (values < needed)[labels[:, 0] == SELF].any():
        needed[_close_at_home(labels, problem, least)] = min(problem.settings.clearance, least)
    return labels[values < needed]


def _close_at_home(labels: Index, problem: GraspProblem, least: float) -> Mask:
    """Return which labels (K, 3) are of parts of the robot that are nearer to each other than `least` m at home.

    So are the first links of fingers, which spreading alone brings together.
    """
    tree, robot = problem.tree, problem.cell.robot
    knuckles = [robot.bodies.index(finger.bodies[0]) for finger in robot.hand.fingers]
    beside = (labels[:, 0] == SELF) & np.isin(labels[:, 1:], knuckles).all(1)
    found = clearances(tree.home, tree, problem.world, least, True)[1]
    found = found[found[:, 0] == SELF]
    return beside | (labels[:, None] == found).all(2).any(1)


def overlap(q: Array, problem: GraspProblem) -> float:
    """Return how deep, m, the robot lies in neighbours or in itself; 0 or less where it is clear of both."""
    values, labels = clearances(q, problem.tree, problem.world, 0.0, True)
    return float(-min(values[np.isin(labels[:, 0], (NEIGHBOUR, SELF))], default=0.0))
