"""A grasp: configuration, contacts, forces, and the set-points that open around and press on the object."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.execution.motion import GraspMotion
from agents.kinematics.forward import body_frames, tip_jacobian, tip_positions
from agents.kinematics.tree import RobotTree
from agents.planning.certificate import Certificate
from agents.planning.settings import PlannerSettings
from agents.planning.subject import Subject
from agents.planning.tip_ik import solve_tips

Array = NDArray[np.float64]
HAND_STIFFNESS = 10.0  # Nm/rad, the hand's position servos
_OPENING = (0.025, 0.035, 0.018, 0.012)  # m that the tips back off along the normals, first choice first
_FINGERS = np.r_[7:15, 19:23]


@dataclass(frozen=True)
class Grasp:
    """A certified grasp; fingers in the order thumb, index, middle, robot base frame.

    Attributes:
        q: (23,) rad, the configuration that the programme made feasible.
        contacts: (3, 3) m on the object's surface.
        normals: (3, 3) out of the object.
        forces: (3, 3) N on the object, that hold it.
        certificate: residuals and margins of every constraint.
        motion: set-points of pregrasp, grasp and squeeze.
        mount: of the hand.
    """

    q: Array
    contacts: Array
    normals: Array
    forces: Array
    certificate: Certificate
    motion: GraspMotion
    mount: str


def finger_jacobians(q: Array, tree: RobotTree) -> Array:
    """Return the linear Jacobians (3, 3, 16) of the tip centres by the hand's joints."""
    R, p = body_frames(q, tree)
    return tip_jacobian(tree, R, p, tip_positions(tree, R, p))[:, :, 7:]


def grasp_motion(
    q: Array,
    normals: Array,
    forces: Array,
    subject: Subject,
    tree: RobotTree,
    settings: PlannerSettings,
    opening: float,
) -> GraspMotion:
    """Return the set-points of a grasp.

    The squeeze is exact for position servos: at rest on the surface a servo whose set-point is J^T f / kp further in
    presses with f.

    Args:
        q: (23,) rad, the grasp.
        normals: (3, 3) out of the object.
        forces: (3, 3) N on the object.
        subject: the object.
        tree: the robot.
        settings: of the planner.
        opening: m that the tips back off before they close.
    """
    R, p = body_frames(q, tree)
    tips = tip_positions(tree, R, p)
    distance, _ = subject.distance.distance_gradient(tips)
    touching, pregrasp = q.copy(), q.copy()
    to_surface = (settings.tip_radius - distance)[:, None] * normals
    solve_tips(touching, tips + to_surface, tree, 30, 1e-5, True)
    solve_tips(pregrasp, tips + to_surface + opening * normals, tree, 40, 1e-4, True)
    torque = np.einsum("frj,fr->j", finger_jacobians(touching, tree), forces)
    squeeze = touching.copy()
    squeeze[7:] = np.clip(touching[7:] + torque / HAND_STIFFNESS, tree.lower[7:], tree.upper[7:])
    return GraspMotion(pregrasp, touching, squeeze)


def openings() -> tuple[float, ...]:
    """Return the openings to try, m."""
    return _OPENING
