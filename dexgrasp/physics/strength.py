"""How strong a grasp is: the push that planned forces bear, and the push that any forces could.

A push is a force w through the centre of mass. The contacts answer it by df = -G^+ (w, 0), the least forces that do, G
the grasp matrix about the centre of mass with torques over the contacts' rms radius.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp.physics.capacity import capacity_kernel
from dexgrasp.physics.checks import check_array, check_contacts, check_positive, rms_radius
from dexgrasp.physics.cones import tangent_basis
from dexgrasp.physics.wrench import grasp_map
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

GRAVITY = 9.81  # m/s^2
BALANCED = 1e-4  # of the weight: what counts as balanced
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 128, endpoint=False)
_REFINEMENTS = 4  # each narrows the bracket of the worst angle sixteenfold
_ROUNDING = 1e-6


class Contacts(NamedTuple):
    """Contacts and what bounds their forces; N contacts, SI units, world axes."""

    points: Array  # (N, 3)
    normals: Array  # (N, 3) out of the object
    jacobians: Array  # (N, 3, joints) of the contact points
    torque_limits: Array  # (joints,) Nm
    friction: float
    centre: Array  # (3,) centre of mass
    mass: float  # kg

    @property
    def weight(self) -> float:
        """N."""
        return self.mass * GRAVITY

    def grasp_matrix(self) -> Array:
        """(6, 3 N) forces -> wrench about the centre of mass, torques over the contacts' rms radius."""
        return grasp_map(self.points, self.centre, rms_radius(self.points))


def directions() -> Array:
    """Return the 26 unit directions (26, 3) to the faces, edges and corners of a cube."""
    grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), -1).reshape(-1, 3)
    grid = grid[np.abs(grid).sum(1) > 0]
    return grid / np.linalg.norm(grid, axis=1, keepdims=True)


def torque_fraction(contacts: Contacts, forces: Array) -> float:
    """Return the largest joint torque of forces (N, 3) over its limit; the joints bear what all contacts ask."""
    torque = np.einsum("frj,fr->j", contacts.jacobians, forces)
    return float((np.abs(torque) / contacts.torque_limits).max())


def hold_residual(contacts: Contacts, forces: Array) -> float:
    """Return what forces (N, 3) leave of gravity, as a part of the weight, torques over the rms radius."""
    wrench = contacts.grasp_matrix() @ forces.ravel()
    wrench[2] -= contacts.weight
    return float(np.linalg.norm(wrench)) / contacts.weight


def load_of(contacts: Contacts, forces: Array) -> float:
    """Return 1 + the largest push, in weights, that forces (N, 3) bear in any direction with the answer G^+.

    Forces that balance a share below 1 of the weight have that share as their load; forces that balance none of it,
    leave a cone or exceed a torque limit have 0.
    """
    contacts = _checked(contacts)
    forces = check_array("forces", forces, (len(contacts.points), 3))
    wrench = contacts.grasp_matrix() @ forces.ravel()
    share = wrench[2] / contacts.weight
    wrench[2] = 0.0
    strayed = float(np.linalg.norm(wrench)) > BALANCED * contacts.weight
    if strayed or share <= 0.0 or torque_fraction(contacts, forces) > 1.0 + _ROUNDING:
        return 0.0
    push = _push(contacts, forces)
    if push < -_ROUNDING:
        return 0.0
    return 1.0 + max(push, 0.0) if share > 1.0 - BALANCED else float(share)


def _push(contacts: Contacts, forces: Array) -> float:
    """Return D = min over contacts and boundary normals a of a.f / (W |A^T a|), A the contact's rows of G^+."""
    G = contacts.grasp_matrix()
    answer: Array = np.asarray(np.linalg.pinv(G, rcond=1e-9)[:, :3], dtype=np.float64)
    if np.abs(G @ answer - np.eye(6, 3)).max() > 1e-6:  # some direction cannot be answered at all
        return min(0.0, _least_ratio(contacts, forces, np.zeros(answer.shape)))
    return _least_ratio(contacts, forces, answer) / contacts.weight


def _least_ratio(contacts: Contacts, forces: Array, answer: Array) -> float:
    t1, t2 = (t[:, None] for t in tangent_basis(contacts.normals))
    blocks, normal = answer.reshape(-1, 3, 3), contacts.friction * contacts.normals[:, None]
    angles, width = np.broadcast_to(_ANGLES, (len(blocks), len(_ANGLES))), _ANGLES[1]
    for _ in range(_REFINEMENTS + 1):
        a = np.cos(angles)[..., None] * t1 + np.sin(angles)[..., None] * t2 - normal
        ratio = (a @ forces[..., None])[..., 0] / np.maximum(np.linalg.norm(a @ blocks, axis=2), 1e-12)
        worst = ratio.argmin(axis=1)[:, None]
        angles = np.take_along_axis(angles, worst, 1) + width * np.linspace(-1.0, 1.0, 33)
        width /= 16.0
    return float(ratio.min())


def capacity_of(contacts: Contacts, stop: float = 0.0, pushes: Array | None = None) -> float:
    """Return 1 + the least, over 26 directions, of the largest push in weights that some forces can balance.

    The forces stay within cones and torque limits; they balance gravity and push together. Where none balance gravity
    alone, it is the largest share of gravity that some do. Joints are of one finger each.

    Args:
        contacts: three.
        stop: what is below need not be known exactly: anything from it up to there may be returned.
        pushes: (K, 3) unit directions, `directions()` by default; the one that ended at `stop` is put first, so that
            grasps alike are refused at once.
    """
    contacts = _checked(contacts)
    if len(contacts.points) != 3:
        raise InputError(f"capacity is that of three contacts, got {len(contacts.points)}")
    jacobians, limits = (
        np.ascontiguousarray(contacts.jacobians),
        np.asarray(contacts.torque_limits, dtype=float),
    )
    return float(
        capacity_kernel(
            contacts.points, contacts.normals, contacts.centre, contacts.weight, contacts.friction, jacobians, limits,
            directions() if pushes is None else pushes, stop,
        )
    )  # fmt: skip


def _checked(contacts: Contacts) -> Contacts:
    check_contacts(contacts.points, contacts.normals)
    check_positive("friction", contacts.friction)
    check_positive("mass", contacts.mass)
    return contacts
