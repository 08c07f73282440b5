"""The squeeze of a grasp: forces at its contacts that hold the object, as firmly as the joints allow."""

from agents.grasp.target import GraspTarget
from agents.kinematics.tree import RobotTree
from agents.physics.forces import HoldingForces, holding_forces
from agents.planning.claims import contacts_of
from agents.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.limits import HAND_TORQUE

NONE = -1
"""Level of a grasp that bears none of the loads."""


def firmest_hold(
    q: Array, target: GraspTarget, tree: RobotTree, settings: PlannerSettings, explain: bool = True
) -> tuple[HoldingForces, int]:
    """Return the forces for the first of `settings.loads` that contacts and joints can bear.

    Args:
        q: (23,) rad.
        target: the object.
        tree: the robot.
        settings: loads, friction, torque limits.
        explain: whether to find out why not even the last load can be borne, which costs time.

    Returns:
        The forces, and which load they are for; those for the last load and `NONE` where it cannot be borne.
    """
    contacts, _ = contacts_of(q, target, tree, settings.friction_hold)
    for level, (share, disturbance) in enumerate(settings.loads):
        hold = holding_forces(
            contacts.points, contacts.normals, settings.friction_hold, share * target.mass, target.centre,
            jacobians=contacts.jacobians, torque_limits=settings.torque_share * HAND_TORQUE,
            f_min=settings.least_press, safety=1.0, disturbance=disturbance,
            explain=explain and level == len(settings.loads) - 1,
        )  # fmt: skip
        if hold.holds:
            return hold, level
    return hold, NONE
