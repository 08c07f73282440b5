"""A grasp: configuration, contacts, forces, and the set-points that open around and press on the object."""

from dataclasses import dataclass

import numpy as np

from dexgrasp.grasp.certificate import Certificate
from dexgrasp_env.arrays import Array, array
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.valid import check

RAISED = 0.14
"""m that what is grasped is lifted."""


@dataclass(frozen=True)
class GraspMotion:
    """A grasp as set-points of the joint servos, (n,) rad each, robot order.

    Attributes:
        pregrasp: fingers open around the object, touching nothing.
        grasp: fingertips in contact.
        squeeze: inside the object, so that the servos press: grasp + J^T f / kp.
    """

    pregrasp: Array
    grasp: Array
    squeeze: Array

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        size = array(np.size(self.pregrasp))
        for name, value in vars(self).items():
            object.__setattr__(self, name, check(f"{name} of a grasp motion, rad", value, size))


@dataclass(frozen=True)
class Grasp:
    """A certified grasp with N contacts; world frame.

    Attributes:
        q: (n,) rad, the configuration that the optimisation made feasible.
        contacts: (N, 3) m on the object's surface.
        normals: (N, 3) out of the object.
        forces: (N, c) N on the object, that hold it; see `mechanics.contacts.Contacts`.
        certificate: residuals and margins of every constraint.
        motion: set-points of pregrasp, grasp and squeeze.
        cell: of the robot.
    """

    q: Array
    contacts: Array
    normals: Array
    forces: Array
    certificate: Certificate
    motion: GraspMotion
    cell: Cell

    @property
    def fingers(self) -> tuple[str, ...]:
        """Names of the fingers that make the contacts, in their order: those of the hand's file."""
        return self.cell.robot.hand.grasp
