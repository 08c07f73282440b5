"""Set-points of the joint servos that open around a grasp, touch, and press."""

from collections.abc import Callable, Iterable

import numpy as np

from dexgrasp.grasp.grasp import GraspMotion
from dexgrasp.kinematics.forward import body_frames, fingertips, tip_jacobian
from dexgrasp.kinematics.tip_ik import solve_tips
from dexgrasp.kinematics.tree import RobotTree
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array

OPENINGS = (0.025, 0.035, 0.018, 0.012)
"""m that the tips back off along the normals, first choice first."""
RISES = (0.0, 0.006)
"""m that they rise besides: none, or off the table, where contacts are low."""


def grasp_motion(
    q: Array, normals: Array, forces: Array, target: GraspTarget, tree: RobotTree, settings: PlannerSettings,
    opening: float, rise: float = 0.0,
) -> GraspMotion:  # fmt: skip
    """Return the set-points of a grasp that opens in one way; the arguments are those of `first_motion`.

    Args:
        opening: m that the tips back off before they close.
        rise: m that they come down as they close.
    """
    motion = first_motion(q, normals, forces, target, tree, settings, [(rise, opening)], lambda _: True)
    assert motion is not None
    return motion


def first_motion(
    q: Array, normals: Array, forces: Array, target: GraspTarget, tree: RobotTree, settings: PlannerSettings,
    ways: Iterable[tuple[float, float]], clear: Callable[[Array], bool],
) -> GraspMotion | None:  # fmt: skip
    """Return the set-points of a grasp with the first way to open that is clear, None where none is.

    The squeeze is exact for position servos: at rest on the surface a servo whose set-point is J^T f / kp further in
    presses with f, J being that of the contact points.

    Args:
        q: (n,) rad, the grasp.
        normals: (3, 3) out of the object.
        forces: (3, 3) N on the object.
        target: the object.
        tree: the robot.
        settings: of the planner.
        ways: of opening: rise and opening, m (see `grasp_motion`).
        clear: whether a pregrasp (n,) rad will do.
    """
    tips = fingertips(q, tree)
    distance, _ = target.distance.distance_gradient(tips)
    goals = tips + (settings.tip_radius - distance)[:, None] * normals
    for rise, opening in ways:
        pregrasp = q.copy()
        solve_tips(pregrasp, goals + opening * normals + [0.0, 0.0, rise], tree, 40, 1e-4, True)
        if clear(pregrasp):
            break
    else:
        return None
    touching = q.copy()
    solve_tips(touching, goals, tree, 30, 1e-5, True)
    contacts = tips - distance[:, None] * normals
    J = tip_jacobian(tree, body_frames(touching, tree), contacts)[:, :, tree.arm :]
    torque = np.einsum("frj,fr->j", J, forces)
    squeeze = touching.copy()
    hand = slice(tree.arm, None)
    squeeze[hand] = np.clip(touching[hand] + torque / tree.stiffness, tree.lower[hand], tree.upper[hand])
    return GraspMotion(pregrasp, touching, squeeze)
