"""Contacts and what bounds their forces, as a value that plain and compiled code take alike."""

from typing import NamedTuple

import numpy as np

from dexgrasp.mechanics.contact_models import ContactModel, HardFinger
from dexgrasp_env.arrays import Array


class Contacts(NamedTuple):
    """N contacts of an object, SI units, world axes.

    A force has c parts: its three axes, and of a soft finger also its torque about the normal, over `model.torsion`.
    """

    points: Array  # (N, 3)
    normals: Array  # (N, 3) out of the object
    jacobians: Array  # (N, c, joints) of the contact points, m; the fourth part their turn by `model.torsion`
    torque_limits: Array  # (joints,) Nm
    friction: Array  # (N,) coefficients
    centre: Array  # (3,) centre of mass
    gravity: Array  # (3,) N, the force of the object's weight
    model: ContactModel = HardFinger()

    @property
    def weight(self) -> float:
        """N."""
        return float(np.sqrt((self.gravity**2).sum()))


class Shape(NamedTuple):
    """Number and model of the contacts of a grasp, and how many independent forces leave the object in balance."""

    contacts: int
    model: ContactModel
    internal: int


def shape_of(count: int, model: ContactModel = HardFinger()) -> Shape:  # noqa: B008  (it is frozen)
    """Return the shape of `count` contacts."""
    return Shape(count, model, max(len(model.parts) * count - 6, 1))


def contiguous(contacts: Contacts) -> Contacts:
    """Return contacts with arrays as compiled code knows them: C-contiguous and writeable."""
    return Contacts._make([*(np.array(part, order="C") for part in contacts[:-1]), contacts.model])
