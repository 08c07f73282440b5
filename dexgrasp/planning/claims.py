"""What the planner claims of a grasp: the certificate, from configuration, forces and object alone."""

import numpy as np

from dexgrasp.grasp.certificate import Certificate
from dexgrasp.kinematics.clearance import clearance_rows, empty_rows
from dexgrasp.kinematics.forward import body_frames, tip_jacobian, tip_positions
from dexgrasp.kinematics.tree import RobotTree
from dexgrasp.physics.margin import margins
from dexgrasp.physics.ratios import wrench_ratios
from dexgrasp.physics.strength import Contacts, capacity_of, hold_residual, load_of, torque_fraction
from dexgrasp.physics.wrench import solve_wrench_qp
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array

FAR = 0.02  # m: clearances beyond are not measured


def contacts_of(q: Array, target: GraspTarget, tree: RobotTree, friction: float) -> tuple[Contacts, Array]:
    """Return the contacts of a configuration `q` (n,) rad, and the tips' distances (3,) m from the surface."""
    frames = body_frames(q, tree)
    tips = tip_positions(tree, frames)
    distance, normals = target.distance.distance_gradient(tips)
    points = tips - distance[:, None] * normals
    jacobians = tip_jacobian(tree, frames, points)[:, :, tree.arm :]
    return Contacts(points, normals, jacobians, tree.torque, friction, target.centre, target.mass), distance


def certificate_of(
    q: Array, forces: Array, target: GraspTarget, tree: RobotTree, settings: PlannerSettings, *,
    with_capacity: bool = True,
) -> Certificate:  # fmt: skip
    """Return what is true of a grasp, however its configuration and forces were found.

    Args:
        q: (n,) rad.
        forces: (3, 3) N on the object, thumb, index, middle.
        target: the object.
        tree: the robot.
        settings: friction coefficients and tip radius.
        with_capacity: False leaves `capacity` at NaN, for grasps still to be chosen among (26 conic programmes).
    """
    contacts, distances = contacts_of(q, target, tree, settings.friction_hold)
    internal = solve_wrench_qp(contacts.points, contacts.normals, settings.friction)
    ratios = wrench_ratios(contacts.points, internal.forces, target.centre)
    load = load_of(contacts, forces)
    return Certificate(
        distances_cm=tuple(float(d) for d in 100.0 * (distances - settings.tip_radius)),
        force_ratio_percent=ratios.force,
        torque_ratio_percent=ratios.torque,
        closure_residual=float(internal.residual),
        closure_margin=float(margins(contacts.points[None], contacts.normals[None], settings.friction)[0][0]),
        min_clearance_m=least_clearance(q, target, tree, tips_touch=True),
        joint_limit_margin_rad=float(np.minimum(q - tree.lower, tree.upper - q).min()),
        max_joint_torque_fraction=torque_fraction(contacts, forces),
        holds=load >= 1.0,
        hold_residual=hold_residual(contacts, forces),
        mass=target.mass,
        load=load,
        capacity=capacity_of(contacts) if with_capacity else float("nan"),
        friction=settings.friction,
    )


def least_clearance(q: Array, target: GraspTarget, tree: RobotTree, tips_touch: bool) -> float:
    """Return the least clearance, m, at most `FAR`; a lower bound, as spheres cover the robot from outside."""
    frames, rows = body_frames(q, tree), empty_rows(160, tree)
    n = clearance_rows(tree, frames, target.distance.obstacle, FAR, tips_touch, rows)
    return float(rows.values[:n].min()) if n else FAR


def is_clear(q: Array, target: GraspTarget, tree: RobotTree, least: float) -> bool:
    """Whether every clearance is `least`, m, or more, the tips' from the object too."""
    rows = empty_rows(160, tree)
    return clearance_rows(tree, body_frames(q, tree), target.distance.obstacle, least, False, rows) == 0
