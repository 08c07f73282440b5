"""Contacts and what bounds their forces, as a value that plain and compiled code take alike."""

from typing import NamedTuple

import numpy as np

from dexgrasp.physics.checks import Numbers, check_array, check_contacts
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

GRAVITY = 9.81  # m/s^2


class Contacts(NamedTuple):
    """N contacts of an object, SI units, world axes; each joint moves one of them alone."""

    points: Array  # (N, 3)
    normals: Array  # (N, 3) out of the object
    jacobians: Array  # (N, 3, joints) of the contact points
    torque_limits: Array  # (joints,) Nm
    friction: Array  # (N,) coefficients
    centre: Array  # (3,) centre of mass
    gravity: Array  # (3,) N, the force of the object's weight

    @property
    def weight(self) -> float:
        """N."""
        return float(np.sqrt((self.gravity**2).sum()))


def checked(contacts: Contacts, count: int | None = None) -> Contacts:
    """Return contacts as contiguous arrays, one friction coefficient and torque limit stated for all as many.

    Raises:
        InputError: wrong shapes, NaN, another number of contacts than `count`, or values out of range.
    """
    points, normals = check_contacts(contacts.points, contacts.normals, count)
    jacobians = check_array("jacobians", contacts.jacobians, (len(points), 3, None))
    gravity = check_array("gravity", contacts.gravity, (3,))
    if not (gravity**2).sum() > 0.0:
        raise InputError("gravity must not be zero: pushes are measured in weights")
    return Contacts(
        points, normals, jacobians, _positive("torque_limits", contacts.torque_limits, jacobians.shape[2]),
        _positive("friction", contacts.friction, len(points)), check_array("centre", contacts.centre, (3,)), gravity,
    )  # fmt: skip


def _positive(name: str, values: Numbers, count: int) -> Array:
    if np.shape(values) not in ((), (count,)):
        raise InputError(f"{name} must be one number or ({count},), got {np.shape(values)}")
    array = check_array(name, np.broadcast_to(np.asarray(values), (count,)), (count,))
    if not (array > 0.0).all():
        raise InputError(f"{name} must be above 0")
    return array
