"""Set-points of the joint servos that open around a grasp, touch, and press."""

import numpy as np

from dexgrasp.grasp.grasp import GraspMotion
from dexgrasp.kinematics.forward import body_frames, fingertips, tip_jacobian
from dexgrasp.kinematics.tip_ik import solve_tips
from dexgrasp.planning.problem import Problem
from dexgrasp_env.arrays import Array

OPENINGS = (0.025, 0.035, 0.018, 0.012)
"""m that the tips back off along the normals, first choice first."""
RISES = (0.0, 0.006)
"""m that they rise besides: none, or off the table, where contacts are low."""


def opened(q: Array, normals: Array, problem: Problem, opening: float, rise: float = 0.0) -> Array:
    """Return the configuration (n,) rad that a grasp closes from.

    Args:
        q: (n,) rad, the grasp.
        normals: (3, 3) out of the object.
        problem: object and robot.
        opening: m that the tips back off before they close.
        rise: m that they come down as they close.
    """
    (_, goals), pregrasp = _touching(q, normals, problem), q.copy()
    solve_tips(pregrasp, goals + opening * normals + [0.0, 0.0, rise], problem.tree, 40, 1e-4, True)
    return pregrasp


def grasp_motion(q: Array, normals: Array, forces: Array, problem: Problem, pregrasp: Array) -> GraspMotion:
    """Return the set-points of a grasp that closes from `pregrasp` (n,) rad.

    The squeeze is exact for position servos: at rest on the surface a servo whose set-point is J^T f / kp further in
    presses with f, J being that of the contact points.

    Args:
        q: (n,) rad, the grasp.
        normals: (3, 3) out of the object.
        forces: (3, 3) N on the object.
        problem: object and robot.
        pregrasp: see `opened`.
    """
    tree, touching = problem.tree, q.copy()
    contacts, goals = _touching(q, normals, problem)
    solve_tips(touching, goals, tree, 30, 1e-5, True)
    J = tip_jacobian(tree, body_frames(touching, tree), contacts)[:, :, tree.arm :]
    torque = np.einsum("frj,fr->j", J, forces)
    squeeze = touching.copy()
    hand = slice(tree.arm, None)
    squeeze[hand] = np.clip(touching[hand] + torque / tree.stiffness, tree.lower[hand], tree.upper[hand])
    return GraspMotion(pregrasp, touching, squeeze)


def _touching(q: Array, normals: Array, problem: Problem) -> tuple[Array, Array]:
    """Return the contacts (3, 3) m, and where the tips' centres are (3, 3) m when they touch there."""
    tips = fingertips(q, problem.tree)
    distance, _ = problem.target.distance.distance_gradient(tips)
    return tips - distance[:, None] * normals, tips + (problem.settings.tip_radius - distance)[
        :, None
    ] * normals
