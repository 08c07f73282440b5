"""Load and capacity of a grasp: the push that planned forces bear, and the push that any forces could.

A push is a force w through the centre of mass. The contacts answer it by df = -G^+ (w, 0), the least forces that do, G
the grasp matrix about the centre of mass with torques over the contacts' rms radius: as they do where all give way
alike. Joints whose set-points stand still give way as their servos are stiff, C = J diag(1/k) J^T m/N at a contact;
they answer by the forces with the least f^T C f, df = -C^-1 G^T (G C^-1 G^T)^-1 (w, 0).
"""

import numpy as np

from dexgrasp.mechanics.cones import tangent_basis
from dexgrasp.mechanics.contacts import Contacts, Shape, contiguous, shape_of
from dexgrasp.mechanics.equilibrium import (
    FLAT,
    answers_to_pushes,
    contact_map,
    internal_forces,
    rms_radius,
)
from dexgrasp.mechanics.margin_lp import (
    Programme,
    add_torques,
    begin,
    empty_programme,
    maximise,
    set_cones,
)
from dexgrasp.mechanics.robust_push import borne_pushes
from dexgrasp_env.arrays import Array, cube_directions
from dexgrasp_env.compiled import leaf, njit

BALANCED = 1e-4  # of the weight: what counts as balanced
_ROUNDING = 1e-6
_FACES, _ROUNDS = 8, 24  # planes of each cone at first, and rounds of further ones


def torque_fraction(contacts: Contacts, forces: Array) -> float:
    """Return the largest joint torque of forces (N, c) over its limit; the joints bear what all contacts ask."""
    return float((np.abs(np.einsum("frj,fr->j", contacts.jacobians, forces)) / contacts.torque_limits).max())


def hold_residual(contacts: Contacts, forces: Array) -> float:
    """Return what forces (N, c) leave of gravity, as a part of the weight, torques over the rms radius."""
    wrench = _grasp_matrix(contacts) @ forces.ravel()
    wrench[:3] += contacts.gravity
    return float(np.linalg.norm(wrench)) / contacts.weight


def _grasp_matrix(contacts: Contacts) -> Array:
    """(6, c N) forces -> wrench about the centre of mass, torques over the contacts' rms radius."""
    return contact_map(
        contacts.points,
        contacts.normals,
        contacts.model.torsion,
        contacts.centre,
        rms_radius(contacts.points),
    )


def load_of(contacts: Contacts, forces: Array, stiffness: Array | None = None) -> float:
    """Return 1 + the largest push, in weights, that forces (N, c) bear in any direction.

    Forces that balance a share below 1 of the weight have that share as their load; forces that balance none of it,
    leave a cone or exceed a torque limit have 0.

    Args:
        contacts: any number.
        forces: (N, c) N on the object.
        stiffness: (joints,) Nm/rad of servos whose set-points stand still: the push is borne with their answer as well
            as with the least; None asks for the least answer alone.
    """
    G, up = _grasp_matrix(contacts), -contacts.gravity / contacts.weight
    wrench = G @ forces.ravel()
    share = float(wrench[:3] @ up) / contacts.weight
    wrench[:3] -= share * contacts.weight * up
    strayed = float(np.linalg.norm(wrench)) > BALANCED * contacts.weight
    if strayed or share <= 0.0 or torque_fraction(contacts, forces) > 1.0 + _ROUNDING:
        return 0.0
    push = _push(contacts, forces, np.asarray(np.linalg.pinv(G, rcond=1e-9)[:, :3], dtype=np.float64))
    if push < -_ROUNDING:
        return 0.0
    if share <= 1.0 - BALANCED:
        return share
    if push > 0.0 and stiffness is not None:
        push = min(push, _push(contacts, forces, _servo_answers(contacts, G, stiffness)))
    return 1.0 + max(push, 0.0)


def _servo_answers(contacts: Contacts, G: Array, stiffness: Array) -> Array:
    """Return (c N, 3) N, what joints of stiffness (joints,) Nm/rad answer a force of 1 N along each axis with."""
    J, yields = contacts.jacobians, np.zeros((G.shape[1], 6))
    if (np.abs(J).max(1) > 0.0).sum(0).max() > 1:  # some joint moves several contacts
        J = J.reshape(1, G.shape[1], -1)
    # m/N that a contact gives way besides its joints, in every direction: hardly, but not nothing
    compliance = J / stiffness @ J.transpose(0, 2, 1) + 1e-6 * np.eye(J.shape[1])
    for i in range(len(J)):
        own = slice(i * J.shape[1], (i + 1) * J.shape[1])
        yields[own] = np.linalg.solve(compliance[i], G[:, own].T)
    return yields @ np.linalg.solve(G @ yields, np.eye(6, 3))


def _push(contacts: Contacts, forces: Array, answers: Array) -> float:
    """Return the push, in weights, that forces (N, c) bear with answers (c N, 3) N to 1 N; 0 if they are none."""
    most = np.inf
    if np.abs(_grasp_matrix(contacts) @ answers - np.eye(6, 3)).max() > 1e-6:
        answers, most = np.zeros_like(answers), 0.0  # some direction cannot be answered at all: no push is
    cones = np.stack(
        [-contacts.friction[:, None] * contacts.normals, *tangent_basis(contacts.normals)], axis=1
    )
    borne = borne_pushes(cones, contacts.weight * answers.reshape(*forces.shape, 3), np.array(forces))
    return min(borne, most)


def capacity_of(contacts: Contacts, stop: float = 0.0, pushes: Array | None = None) -> float:
    """Return 1 + the least, over 26 directions, of the largest push in weights that some forces can balance.

    The forces stay within cones and torque limits; they balance gravity and push together. Where none balance gravity
    alone, it is the largest share of gravity that some do.

    Args:
        contacts: two soft fingers, or three or more.
        stop: what is below need not be known exactly: anything from it up to there may be returned.
        pushes: (K, 3) unit directions, `cube_directions` by default; the one that ended at `stop` is put first, so that
            grasps alike are refused at once.
    """
    shape = shape_of(len(contacts.points), contacts.model)
    return float(
        _capacity(contiguous(contacts), shape, cube_directions() if pushes is None else pushes, stop)
    )


@njit
def _capacity(contacts: Contacts, shape: Shape, pushes: Array, stop: float) -> float:
    n, parts, joints = shape.contacts, len(shape.model.parts), contacts.torque_limits.shape[0]
    p = empty_programme(shape, shape.internal + 1, n * (_FACES + _ROUNDS + 2 * joints))
    answers, hold = np.empty((n, parts, 3)), np.empty((n, parts))
    if not internal_forces(contacts.points, contacts.normals, contacts.model.torsion, p.span) > FLAT:
        return 0.0
    set_cones(p, contacts.normals, contacts.friction)
    answers_to_pushes(contacts, answers, hold)
    p.span[:, :, -1] = hold
    share = _most(p, contacts)
    if share < 1.0:
        return share
    least = np.inf
    for k in range(pushes.shape[0]):
        p.fixed[:], p.span[:, :, -1] = hold, 0.0
        for axis in range(3):
            p.span[:, :, -1] -= answers[:, :, axis] * pushes[k, axis]
        least = min(least, _most(p, contacts))
        if 1.0 + least < stop:
            for c in range(3):
                pushes[0, c], pushes[k, c] = pushes[k, c], pushes[0, c]
            break
    return 1.0 + least


@leaf
def _most(p: Programme, contacts: Contacts) -> float:
    begin(p, 1e6, _FACES)  # weights: no push is larger
    add_torques(p, contacts, np.inf)
    # N of friction that forces may be beyond their cones
    return max(p.lp.z[-1], 0.0) if maximise(p, _ROUNDS, 2e-7, -np.inf) else 0.0
