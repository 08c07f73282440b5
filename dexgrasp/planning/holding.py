"""The squeeze of a grasp: forces at its contacts that bear the largest push, were its surface more slippery."""

from typing import NamedTuple

import numpy as np

from dexgrasp.geometry.neighbours import SEEN
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.mechanics.contacts import Contacts
from dexgrasp.mechanics.internal_force import Squeeze, firmest_squeeze
from dexgrasp.mechanics.kinematics.forward import fingertips, hand_contact_jacobian
from dexgrasp.planning.settings import GraspProblem, PlannerSettings
from dexgrasp_env.arrays import Array

ENOUGH = 6.0
"""Weights: to bear a larger push only strains the hand."""
DOWN = np.array([0.0, 0.0, -1.0])
UNBALANCED = "no forces within friction cones and joint torques balance gravity at these contacts"


class GraspForces(NamedTuple):
    """Forces that hold an object, and how much they bear."""

    contacts: Contacts
    distances: Array  # (N,) m, of the tips' centres from the surface
    forces: Array  # (N, c) N on the object
    share: float  # of the weight that the forces balance
    robust_load: float  # that is left with less friction: grasps are ranked by it

    @property
    def holds(self) -> bool:
        """True where the forces balance the assumed weight."""
        return self.share >= 1.0


def narrowed_friction(normals: Array, target: GraspTarget, settings: PlannerSettings) -> Array:
    """Return the friction (N,) that is left of `settings.friction_squeeze` where the surface was guessed.

    Beyond what a surface that was seen is off as well, the cone is narrowed by the angle of its error over
    3 cm.

    Args:
        normals: (N, 3) of the surface.
        target: the object.
        settings: friction.
    """
    if target.uncertainty is None:
        return np.full(len(normals), settings.friction_squeeze)
    turn = np.maximum(target.uncertainty.along(normals) - SEEN, 0.0) / 0.03
    # 0.02 rad is left of a cone that has been narrowed to nothing.
    return np.tan(np.maximum(np.arctan(settings.friction_squeeze) - turn, 0.02))


def contacts_of(q: Array, problem: GraspProblem, friction: float) -> tuple[Contacts, Array]:
    """Return the contacts of a configuration `q` (n,) rad, and the tips' distances (N,) m from the surface."""
    target, tree = problem.target, problem.tree
    tips = fingertips(q, tree)
    distance, normals = target.distance.distance_gradient(tips)
    points = tips - distance[:, None] * normals
    J, mu = hand_contact_jacobian(q, points, normals, tree), np.full(len(points), friction)
    return Contacts(points, normals, J, tree.torque, mu, target.centre, target.weight, tree.model), distance


def firmest_forces(q: Array, problem: GraspProblem) -> GraspForces:
    """Return the forces that bear the largest push within narrowed cones; failing that, within those of the judge.

    Where nothing balances any of the weight, they press straight in.

    Args:
        q: (n,) rad.
        problem: object and robot; of the settings friction, least press and torque limits.
    """
    settings = problem.settings
    contacts, distance = contacts_of(q, problem, settings.friction_hold)
    firm, most = _squeezes(contacts, problem, DOWN)
    if most.share == 0.0:
        forces = np.zeros(contacts.jacobians.shape[:2])
        forces[:, :3] = -settings.least_press * contacts.normals
        return GraspForces(contacts, distance, forces, 0.0, 0.0)
    return GraspForces(contacts, distance, most.forces, most.share, min(firm.load, most.load))


def lightened(hold: GraspForces, problem: GraspProblem) -> GraspForces:
    """Return a hold of part of the weight made that of a lighter object: the mass is assumed, and mostly too high.

    Forces that balance all they can are at the edge of a cone or of a torque limit, and bear no push. These bear the
    largest push on an object that weighs half as much.

    Args:
        hold: whatever it bears; one that bears the whole weight, or nothing, stays as it is.
        problem: that it was found for.
    """
    if hold.holds or hold.share == 0.0:
        return hold
    part = 0.5 * hold.share  # of the weight: half of what can be balanced
    firm, most = _squeezes(hold.contacts, problem, part * DOWN)
    return hold._replace(forces=most.forces, robust_load=part * firm.load)


def _squeezes(contacts: Contacts, problem: GraspProblem, down: Array) -> tuple[Squeeze, Squeeze]:
    """Return the squeeze within narrowed cones; and it again, or if it bears too little that within the judge's."""
    firm = robust_squeeze(contacts, problem, down)
    if firm.share >= 1.0:
        return firm, firm
    judged = np.full(len(contacts.points), problem.settings.friction_hold)
    return firm, _firmest_at(contacts, judged, problem.settings, down)


def robust_squeeze(contacts: Contacts, problem: GraspProblem, down: Array) -> Squeeze:
    """Return the forces within narrowed cones and torque limits that bear the largest push.

    Args:
        contacts: of the grasp.
        problem: the object; of the settings friction, least press and torque limits.
        down: (3,) the way gravity points.
    """
    friction = narrowed_friction(contacts.normals, problem.target, problem.settings)
    return _firmest_at(contacts, friction, problem.settings, down)


def _firmest_at(contacts: Contacts, friction: Array, settings: PlannerSettings, down: Array) -> Squeeze:
    limits = settings.torque_share * contacts.torque_limits
    counted = contacts._replace(friction=friction, torque_limits=limits, gravity=contacts.weight * down)
    return firmest_squeeze(_no_firmer(counted, settings.max_force), settings.least_press, ENOUGH)


def _no_firmer(contacts: Contacts, most: float | None) -> Contacts:
    """Return contacts none of which is pressed with more than `most` N: that is the torque of one more joint each."""
    if most is None:
        return contacts
    count, parts, joints = contacts.jacobians.shape
    J, each = np.zeros((count, parts, joints + count)), np.arange(count)
    J[..., :joints] = contacts.jacobians
    J[each, :3, joints + each] = contacts.normals
    return contacts._replace(
        jacobians=J, torque_limits=np.append(contacts.torque_limits, np.full(count, most))
    )
