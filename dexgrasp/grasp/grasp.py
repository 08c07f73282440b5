"""A grasp: configuration, contacts, forces, and the set-points that open around and press on the object."""

from dataclasses import dataclass

import numpy as np

from dexgrasp.grasp.certificate import Certificate
from dexgrasp.grasp.values import LIFT_HEIGHT
from dexgrasp_env.arrays import Array, array
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.valid import check


@dataclass(frozen=True)
class GraspMotion:
    """A grasp as set-points of the joint servos, (n,) rad each, robot order.

    Attributes:
        pregrasp: fingers open around the object, touching nothing.
        grasp: fingertips in contact.
        squeeze: inside the object, so that the servos press: grasp + J^T f / kp.
        lift_height: how far to lift, m.
    """

    pregrasp: Array
    grasp: Array
    squeeze: Array
    lift_height: float = 0.14

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        for name in ("pregrasp", "grasp", "squeeze"):
            value = check(
                f"{name} of a grasp motion, rad", getattr(self, name), array(np.size(self.pregrasp))
            )
            object.__setattr__(self, name, value)
        check("lift_height", self.lift_height, LIFT_HEIGHT)


@dataclass(frozen=True)
class Grasp:
    """A certified grasp with N contacts; world frame.

    Attributes:
        q: (n,) rad, the configuration that the optimisation made feasible.
        contacts: (N, 3) m on the object's surface.
        normals: (N, 3) out of the object.
        forces: (N, c) N on the object, that hold it; see `physics.contacts.Contacts`.
        certificate: residuals and margins of every constraint.
        motion: set-points of pregrasp, grasp and squeeze.
        cell: of the robot.
        fingers: whose tips make the contacts, in their order; those of the hand's file by default.
    """

    q: Array
    contacts: Array
    normals: Array
    forces: Array
    certificate: Certificate
    motion: GraspMotion
    cell: Cell
    fingers: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Name the fingers."""
        object.__setattr__(self, "fingers", self.fingers or self.cell.robot.hand.grasp)
