"""Proposals to whole configurations: starting postures for the optimiser.

Two ways. The atlas finds hand postures whose tips make the proposal's triangle and places the palm by rigid alignment.
The way of section 3.3 starts from a palm above the object in six orientations and moves the tips by IK.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dexgrasp.mechanics.contacts import Contacts, Shape
from dexgrasp.mechanics.internal_force import empty_room, squeeze_estimate
from dexgrasp.mechanics.kinematics.clearance import part_clearance, place_body, surface_clearance
from dexgrasp.mechanics.kinematics.forward import (
    contact_jacobian,
    empty_frames,
    forward,
    forward_part,
    tip_positions,
    to_world,
)
from dexgrasp.mechanics.kinematics.palm_ik import PALM_DOWN, reach_palm
from dexgrasp.mechanics.kinematics.tip_ik import solve_tips
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp.mechanics.kinematics.world import World
from dexgrasp.planning.asked_rows import APART
from dexgrasp.planning.atlas import hand_atlas
from dexgrasp.planning.certificate_builder import overlap
from dexgrasp.planning.holding import ENOUGH, narrowed_friction
from dexgrasp.planning.placement import Placements, assignments, place_on_atlas
from dexgrasp.planning.proposals import Proposals
from dexgrasp.planning.settings import GraspProblem
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import njit
from dexgrasp_env.poses import about_z

_REACH_ATTEMPTS = 4  # arm solutions attempted for a posture that is asked for
_FOLDED, _SPREADS = 0.85, 0.3  # share of the range that a folded joint has turned; rad below 0 if it spreads
_DEEPEST = 0.005  # m in a neighbour from which the optimiser seldom finds out
_ROOM = 0.012  # m between hand and neighbours beyond which there is room to open
_CROWDED = 60.0  # load that a metre less of room is worth
_POSE = 0.2  # load that a unit of a placement's score is worth


@dataclass(frozen=True)
class Posture:
    """A start for the optimiser.

    Attributes:
        q: (n,) rad.
        problem: what it is a start for.
        score: the higher, the likelier.
    """

    q: Array
    problem: GraspProblem
    score: float


def atlas_postures(proposals: Proposals, problem: GraspProblem) -> Iterator[Posture]:
    """Yield postures from the atlas, firmest first, with the arm solved; at most `settings.postures`, one a triple."""
    settings, tree = problem.settings, problem.tree
    orders = assignments(settings.proposed.contacts)[: 1 if proposals.assigned else None]
    placed = place_on_atlas(proposals.contacts, proposals.normals, problem, orders, settings.neighbours)
    demand = problem.target.demand
    placed = placed.select(demand.off(placed.rotations[:, :, 0]) <= demand.degrees)
    rank = loads_on(placed, problem) + _POSE * placed.scores
    tried: set[int] = set()
    found = 0
    for k in _by_room(placed, rank, problem):
        # Where the arm does not reach at all, it should not be asked about every posture there is.
        if found == settings.postures or len(tried) == _REACH_ATTEMPTS * settings.postures:
            return
        if placed.triple[k] in tried:
            continue
        tried.add(placed.triple[k])
        q = tree.home.copy()
        q[tree.arm :] = hand_atlas(problem.cell).joints[placed.which[k]]
        if reach_palm(q, placed.rotations[k], placed.positions[k], tree) and _has_room(q, problem):
            found += 1
            yield Posture(q, problem, float(rank[k]))


def _by_room(placed: Placements, rank: Array, problem: GraspProblem) -> Index:
    """Return placements, the likeliest first: by rank (M,), those set back that lack room for the hand."""
    target = problem.target
    if target.around is not None or target.barred.n:
        robot, tree = problem.cell.robot, problem.tree
        bodies = [robot.bodies.index(name) for finger in robot.grasping for name in finger.bodies]
        of_hand, joints = np.array([tree.palm, *bodies]), hand_atlas(problem.cell).joints
        lack = _lack(placed, joints, tree, of_hand, problem.world, target.barred_groups)
        rank = rank - _CROWDED * lack
    return np.argsort(-rank, kind="stable")


@njit
def _lack(
    placed: Placements, joints: Array, tree: RobotTree, bodies: Index, world: World, barred: tuple[Array, Array]
) -> Array:  # fmt: skip
    """Return what placements lack of room (M,) m for some bodies of the hand.

    At most `_ROOM` from what stands around, and the sum of what each lacks from surface that is not to be touched.
    """
    out, frames = np.zeros(len(placed.which)), empty_frames(tree)
    q, ends = np.zeros(len(tree.lower)), np.empty((3, 6))
    for m in range(len(out)):
        q[tree.arm :] = joints[placed.which[m]]
        frames.R[tree.palm] = placed.rotations[m] @ tree.palm_rotation.T
        frames.p[tree.palm] = placed.positions[m] - frames.R[tree.palm] @ tree.palm_offset
        forward_part(q, tree, frames, tree.palm + 1, len(tree.parent))
        room = _ROOM
        for b in bodies:
            place_body(world, frames, b)
            room = part_clearance(world, b, world.objects, len(world.part), room, False, ends)
            out[m] -= surface_clearance(barred, APART, world, b, 0.0, ends)[0]
        out[m] += _ROOM - room
    return out


def _has_room(q: Array, problem: GraspProblem) -> bool:
    """Return True if neighbours leave a posture room that the optimiser can find.

    Idle fingers that lack it are folded: `q` (n,) is changed in place.
    """
    if problem.target.around is None:
        return True
    deep = overlap(q, problem)
    if deep > 0.0:
        folded, tree = q.copy(), problem.tree
        idle = np.setdiff1d(np.arange(len(q)), tree.moved)
        low = tree.lower[idle]
        folded[idle] = np.where(low < -_SPREADS, tree.home[idle], low + _FOLDED * (tree.upper[idle] - low))
        if (other := overlap(folded, problem)) < deep:
            q[:], deep = folded, other
    return deep < _DEEPEST


def loads_on(placed: Placements, problem: GraspProblem) -> Array:
    """Return what the squeeze of each placement would bear (M,), were its tips to reach their goals exactly.

    Args:
        placed: postures of the atlas on goals.
        problem: object and robot; of the settings friction and torque limits.
    """
    goals, target, tree, settings = placed.goals, problem.target, problem.tree, problem.settings
    shape = settings.proposed
    friction = narrowed_friction(-goals.inward.reshape(-1, 3), target, settings).reshape(-1, shape.contacts)
    burden = _Burden(
        settings.tip_height, target.centre, target.weight, friction, settings.torque_share * tree.torque
    )
    return _estimates(placed, hand_atlas(problem.cell).joints, tree, burden, shape)


class _Burden(NamedTuple):
    """Load of a squeeze, and its limits; a contact is `height` from its tip's centre."""

    height: float  # m
    centre: Array  # (3,) m
    gravity: Array  # (3,) N
    friction: Array  # (K, n) at the goals
    limit: Array  # (h,) Nm


@njit
def _estimates(placed: Placements, joints: Array, tree: RobotTree, burden: _Burden, shape: Shape) -> Array:
    """Loads (M,) of placements. The arm does not matter to them."""
    height, friction, limit = burden.height, burden.friction, burden.limit
    n, parts = shape.contacts, len(shape.model.parts)
    frames, room, q = empty_frames(tree), empty_room(shape, len(limit)), np.zeros(len(tree.lower))
    J, hand = np.zeros((n, parts, len(q))), np.empty((n, parts, len(limit)))
    out, points, normals = np.empty(len(placed.which)), np.empty((n, 3)), np.empty((n, 3))
    nothing, down, middle, shift = np.zeros(3), np.empty(3), np.empty(3), np.empty(3)
    forward(q, tree, frames)
    palm = frames.R[tree.palm] @ tree.palm_rotation
    for m in range(len(out)):
        goal = placed.triple[m]
        q[tree.arm :] = joints[placed.which[m]]
        forward_part(q, tree, frames, tree.palm + 1, len(tree.parent))
        # All in the frame of the hand as the kinematics have it: x -> turn x + shift.
        turn = palm @ np.ascontiguousarray(placed.rotations[m].T)
        for r in range(3):
            shift[r] = frames.p[tree.palm, r]
            for c in range(3):
                shift[r] += (
                    frames.R[tree.palm, r, c] * tree.palm_offset[c] - turn[r, c] * placed.positions[m, c]
                )
        tips = tip_positions(tree, frames)
        to_world(turn, shift, burden.centre, middle)
        to_world(turn, nothing, burden.gravity, down)
        for i in range(n):
            inward = placed.goals.inward[goal, i]
            to_world(turn, shift, placed.goals.centres[goal, i] + height * inward, points[i])
            to_world(turn, nothing, -inward, normals[i])
            tips[i] -= height * normals[i]
        contact_jacobian(tree, frames, tips, normals, tree.palm, J)
        hand[:] = J[:, :, tree.arm :]
        contacts = Contacts(points, normals, hand, limit, friction[goal], middle, down, shape.model)
        out[m] = squeeze_estimate(contacts, ENOUGH, room)
    return out


def posture_at(R: Array, p: Array, tips: Array, problem: GraspProblem) -> Posture | None:
    """Return what IK finds for tips (g, 3) m from a palm at `p` (3,) m, turned by `R` (3, 3); None out of reach."""
    tree, q = problem.tree, problem.tree.home.copy()
    if not reach_palm(q, R, p, tree):
        return None
    return Posture(q, problem, -solve_tips(q, tips, tree, 60, 1e-3))


def oriented_postures(tips: Array, problem: GraspProblem) -> list[Posture]:
    """Return IK solutions for tips (g, 3) m from palms above the object, turned in even steps (section 3.3)."""
    middle = tips.mean(0)
    middle[2] = problem.target.top + 0.09
    count, postures = problem.settings.initial_orientations, []
    for k in range(count):
        R = about_z(2.0 * np.pi * k / count) @ PALM_DOWN
        if found := posture_at(R, middle + R @ [0.0, 0.0, 0.03], tips, problem):
            postures.append(found)
    return sorted(postures, key=lambda posture: -posture.score)
