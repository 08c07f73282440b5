"""A feasible configuration made a grasp: set-points that open around it, touch and press, and the certificate."""

from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from dexgrasp.grasp.grasp import Grasp, GraspMotion
from dexgrasp.mechanics.kinematics.clearance import NEIGHBOUR, SELF
from dexgrasp.mechanics.kinematics.forward import (
    body_frames,
    fingertips,
    follow,
    hand_contact_jacobian,
    stop_torques,
    tip_jacobian,
)
from dexgrasp.mechanics.kinematics.tip_ik import solve_tips
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp.mechanics.strength import capacity_of
from dexgrasp.motion.timing import ramp
from dexgrasp.planning.certificate_builder import certificate_of, too_near
from dexgrasp.planning.holding import UNBALANCED, GraspForces
from dexgrasp.planning.postures import Posture
from dexgrasp.planning.proposals import LEAST_OPENING
from dexgrasp.planning.settings import GraspProblem
from dexgrasp.planning.sqp import Solution
from dexgrasp_env.arrays import Array, Index, unit

OPENINGS = (0.025, 0.035, 0.018, 0.012)
"""m that the tips back off along the normals, first choice first."""
_EACH = (LEAST_OPENING, 0.012, 0.018, 0.025)
"""m of each fingertip, where neighbours leave them unequal room, narrowest first."""
OPEN_CLEARANCE = 0.004  # m between the open hand and the object, table and itself


class Candidate(NamedTuple):
    """A feasible configuration, where it was started from, and its squeeze."""

    start: Posture
    solution: Solution
    hold: GraspForces


class NoGrasp(Exception):  # noqa: N818  (it is an outcome, not a defect)
    """Reason why a configuration is no grasp: a word that can be counted, and by how much, where that is a number."""


def certified(candidate: Candidate, with_closure: bool) -> Grasp:
    """Return the grasp of a feasible configuration and its squeeze.

    Args:
        candidate: the configuration.
        with_closure: False reports forces that fail to hold in the certificate instead of refusing them.

    Raises:
        NoGrasp: for what it lacks.
    """
    problem, hold = candidate.start.problem, candidate.hold
    settings, q, at = problem.settings, candidate.solution.q, candidate.solution.evaluation
    if with_closure:
        lacking = settings.lowest_contact(problem.target.top) - float(at.contacts[:, 2].min())
        if lacking > 0.0:
            raise NoGrasp("contact_height", lacking)
        if not problem.target.was_seen(at.contacts).all():
            raise NoGrasp("surface_not_seen")
        if hold.share == 0.0:
            raise NoGrasp(f"holding_forces: {UNBALANCED}", 1.0)
    # Firm grasps are many. One that is not is worth another way to open.
    rises = settings.rises[:1] if hold.robust_load >= settings.firm_load else settings.rises
    if problem.target.neighbours:
        ways = (_opened_each(q, at.normals, problem, rise) for rise in rises)
    else:
        ways = (opened(q, at.normals, problem, opening, rise) for rise, opening in product(rises, OPENINGS))
    pregrasp = next((way for way in ways if _is_open(way, q, problem)), None)
    if pregrasp is None:
        raise NoGrasp("pregrasp_clearance")
    motion = grasp_motion(q, at.normals, hold.forces, problem, pregrasp)
    missed = fingertips(motion.grasp, problem.tree) - (at.contacts + settings.tip_radius * at.normals)
    # 4 mm beside it will do where a finger has too few joints to meet it, as for `verify`.
    if np.linalg.norm(missed, axis=1).max() < 0.004:
        missed = _mendable(missed, motion.grasp, problem.tree)
    # Closed tips may be 0.25 mm from the surface, as fingers may end before; `verify` allows 0.3 mm.
    if (farthest := float(np.linalg.norm(missed, axis=1).max())) > 2.5e-4:
        raise NoGrasp("surface_out_of_reach", farthest)
    contacts = hold.contacts
    loose = stop_torques(q, contacts.points, contacts.normals, hold.forces, problem.tree)
    if with_closure and loose.min(initial=0.0) < 0.0:
        raise NoGrasp("tendon_pulls_joint_off_its_stop", -float(loose.min()))
    return pressed(candidate, hold.forces, motion)


def _mendable(missed: Array, q: Array, tree: RobotTree) -> Array:
    """Return the part (N, 3) m of a miss that the fingers' joints could mend: all of it where they have three each."""
    joints = tree.moved[tree.moved >= tree.arm]
    if len(joints) >= missed.size:
        return missed
    J = tip_jacobian(tree, body_frames(q, tree), fingertips(q, tree)).reshape(missed.size, -1)[:, joints]
    return (J @ np.linalg.pinv(J) @ missed.ravel()).reshape(missed.shape)


def _is_open(pregrasp: Array, q: Array, problem: GraspProblem) -> bool:
    """Return True for a hand that is clear where it is open, and of neighbours until it has closed to `q` (n,) rad."""
    return not len(too_near(pregrasp, problem, OPEN_CLEARANCE)) and not (
        problem.target.neighbours and len(_in_the_way(pregrasp, q, problem))
    )


def _in_the_way(pregrasp: Array, q: Array, problem: GraspProblem) -> Index:
    """Return the labels (K, 3) of the bodies that neighbours are nearer to than they may be while the hand closes."""
    between = ramp(pregrasp, q, 6)[:-1]  # pieces: tips go 6 mm from one to the next
    near = np.concatenate([too_near(way, problem, problem.settings.clearance) for way in between])
    return near[near[:, 0] == NEIGHBOUR]


def pressed(candidate: Candidate, forces: Array, motion: GraspMotion) -> Grasp:
    """Return the grasp of a configuration that presses with forces (N, c) N, with its certificate."""
    problem, q, at = candidate.start.problem, candidate.solution.q, candidate.solution.evaluation
    certificate = certificate_of(q, forces, candidate.hold.contacts, candidate.hold.distances, problem)
    return Grasp(q, at.contacts, at.normals, forces, certificate, motion, problem.cell)


def completed(grasp: Grasp, hold: GraspForces) -> Grasp:
    """Return a grasp that was chosen with its capacity, 26 programmes, which its load does not exceed."""
    capacity = capacity_of(hold.contacts)
    load = min(grasp.certificate.load, capacity)
    return replace(grasp, certificate=replace(grasp.certificate, capacity=capacity, load=load))


def opened(q: Array, normals: Array, problem: GraspProblem, opening: float, rise: float = 0.0) -> Array:
    """Return the configuration (n,) rad that a grasp closes from.

    Args:
        q: (n,) rad, the grasp.
        normals: (N, 3) out of the object.
        problem: object and robot.
        opening: m that the tips back off before they close.
        rise: m that they come down as they close.
    """
    (_, goals), pregrasp, out = _touching(q, normals, problem), q.copy(), normals
    if problem.settings.is_low(problem.target.top):  # coming from above, tips would meet its edge too high up
        out = unit(normals * [1.0, 1.0, 0.0])
    goals = goals + opening * out + [0.0, 0.0, rise]
    solve_tips(pregrasp, goals, problem.tree, 40, 1e-4, True)
    robot = problem.cell.robot
    if robot.hand.tendons:  # free fingers curl more than fingers on an object
        tips, curled = (fingertips(way, problem.tree) for way in (pregrasp, robot.freed(pregrasp)))
        solve_tips(pregrasp, goals + tips - curled, problem.tree, 40, 1e-4, True)
    return robot.freed(pregrasp)


def _opened_each(q: Array, normals: Array, problem: GraspProblem, rise: float) -> Array:
    """Return a configuration (n,) rad in which each finger is open as wide as it can go without meeting a neighbour.

    Those that have no room at all stay where they grasp.
    """
    robot, pregrasp = problem.cell.robot, q.copy()
    bodies = [{robot.bodies.index(name) for name in finger.bodies} for finger in robot.grasping]
    free = dict(enumerate(bodies))
    for opening in _EACH:
        way = opened(q, normals, problem, opening, rise)
        near = too_near(way, problem, OPEN_CLEARANCE)
        blocked = set(near[near[:, 0] != SELF, 1].tolist())
        free = {finger: own for finger, own in free.items() if not own & blocked}
        if len(free) < len(bodies) and opening == _EACH[0]:
            break
        for finger in free:
            first, end = problem.tree.fingers[finger]
            pregrasp[first:end] = way[first:end]
    return robot.freed(pregrasp)


def grasp_motion(
    q: Array, normals: Array, forces: Array, problem: GraspProblem, pregrasp: Array
) -> GraspMotion:
    """Return the set-points of a grasp that closes from `pregrasp` (n,) rad.

    The squeeze is exact for position servos: at rest on the surface a servo whose set-point is J^T f / kp further in
    presses with f, J being that of the contact points.

    Args:
        q: (n,) rad, the grasp.
        normals: (N, 3) out of the object.
        forces: (N, c) N on the object.
        problem: object and robot.
        pregrasp: see `opened`.
    """
    tree, touching = problem.tree, q.copy()
    contacts, goals = _touching(q, normals, problem)
    solve_tips(touching, goals, tree, 30, 1e-5, True)
    torque = np.einsum("frj,fr->j", hand_contact_jacobian(touching, contacts, normals, tree), forces)
    squeeze = touching.copy()
    hand = slice(tree.arm, None)
    squeeze[hand] = np.clip(touching[hand] + torque / tree.stiffness, tree.lower[hand], tree.upper[hand])
    follow(squeeze, tree)
    return GraspMotion(pregrasp, touching, squeeze)


def _touching(q: Array, normals: Array, problem: GraspProblem) -> tuple[Array, Array]:
    """Return the contacts (N, 3) m, and where the tips' centres are (N, 3) m when they touch there."""
    tips = fingertips(q, problem.tree)
    off = problem.target.distance.distance(tips)[:, None]
    return tips - off * normals, tips + (problem.settings.tip_radius - off) * normals
