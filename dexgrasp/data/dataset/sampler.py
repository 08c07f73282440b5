"""Sampling of grasps, step 5 of section 1.3: finger assignments and kinematics of varied feasible triples.

Triples are drawn with a weight that falls with the number of grasps that use their points, so that grasps cover the
object. Triples at which no forces could bear it are left out. Each other one is tried with all six assignments of
fingers; an assignment that the hand's atlas can place, and whose squeeze is estimated to bear the object, gets a random
placement of the object before the robot, inverse kinematics of the arm, and the bilevel optimisation.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from dexgrasp.data.dataset.rest_scene import RestScene, Triples, rest_scene, rng_of, target_at
from dexgrasp.data.dataset.settings import DatasetSettings
from dexgrasp.mechanics.contacts import Contacts, Shape
from dexgrasp.mechanics.internal_force import empty_room, squeeze_estimate
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame, reach_palm
from dexgrasp.mechanics.margin import margins_to
from dexgrasp.mechanics.strength import load_of, torque_fraction
from dexgrasp.planning.atlas import hand_atlas
from dexgrasp.planning.certificate_builder import FAR
from dexgrasp.planning.certifier import Candidate
from dexgrasp.planning.constraints import fixed_rows
from dexgrasp.planning.placement import assignments, place_on_atlas
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.postures import Posture, loads_on
from dexgrasp.planning.result import SearchLog
from dexgrasp.planning.settings import GraspProblem, PlannerSettings
from dexgrasp_env.arrays import Array, Fields, Index, Mask
from dexgrasp_env.compiled import njit
from dexgrasp_env.poses import about_z, matrix_to_quat

BATCH = 128  # triples drawn at once
PLACEMENTS = 3  # placements tried until the arm reaches
REACH = ((0.40, 0.60), (-0.15, 0.15))  # m, range of placements in x and y
MOST_FORCE = 15.0  # N along each axis: a finger's 0.7 Nm over the shortest lever that any posture has
NONE = -1
"""Level of a grasp that bears none of `PlannerSettings.loads`."""
_ROUGH = 1e-2  # of the margin
COUNTS = ("triples_tried", "assignments_tried", "placed_by_atlas", "reached_by_arm", "feasible", "holding")


@dataclass
class ShardGrasps:
    """Grasps found for a shard, each as its fields, and the counts of tries by stage."""

    grasps: list[Fields] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    log: SearchLog = field(default_factory=SearchLog)

    def __len__(self) -> int:
        """Return the number of grasps."""
        return len(self.grasps)


@dataclass(frozen=True)
class PlacedPosture(Posture):
    """Start of the optimisation with the object placed within the arm's reach.

    Attributes:
        triple: (n,) indices of the contacts, thumb, index, middle; of a gripper two.
        placement: of the object: x m, y m, yaw rad.
    """

    triple: Triples
    placement: Array


def sample_shard(target: str, pose: int, chunk: int, settings: DatasetSettings) -> ShardGrasps:
    """Find the grasps of one shard; the same for the same settings, on any machine with the same versions."""
    scene = rest_scene(target, pose, settings)
    sampler = _Sampler(scene, settings, rng_of(settings, scene.name, pose, 1 + chunk))
    own = scene.triples[rng_of(settings, scene.name, pose, 0).permutation(len(scene.triples))][
        chunk :: settings.chunks
    ]
    # A corner's column is gathered from at every draw.
    found = sampler.run(np.asfortranarray(own), settings.quota(chunk))
    if len(found):  # all at once: one costs as much as a hundred
        turns = matrix_to_quat(np.array([grasp["palm_rotation"] for grasp in found.grasps]))
        for grasp, turn in zip(found.grasps, turns, strict=True):
            grasp["palm_quat_wxyz"] = turn
    return found


class _Sampler:
    def __init__(self, scene: RestScene, settings: DatasetSettings, rng: np.random.Generator) -> None:
        self._scene, self._settings, self._rng = scene, settings, rng
        self._planner, self._found = Planner(settings.planner, cell=settings.cell), ShardGrasps()
        self._problem = GraspProblem(scene.grasp_target, self._planner.cell, self._planner.settings)
        self._use = np.zeros(len(scene.points))

    def run(self, own: Triples, quota: int) -> ShardGrasps:
        """Try triples (M, 3), less used ones first, until `quota` grasps are found or the tries are used up."""
        left, found, tries = np.ones(len(own), bool), self._found, self._settings.tries * quota
        while left.any() and len(found) < quota and found.counts["placed_by_atlas"] < tries:
            drawn = _draw(own, left, self._use, self._rng)
            left[drawn] = False
            found.counts["triples_tried"] += len(drawn)
            likely = bearable(self._scene, own[drawn], self._settings)
            for candidate in self._planner.candidates(self._starts(likely), found.log):
                self._add(candidate)
                if len(found) == quota:
                    break
        return found

    def _starts(self, triples: Triples) -> Iterator[PlacedPosture]:
        """Yield starts for the assignments of triples that the arm reaches and that are likely to bear the object."""
        if not len(triples):
            return
        scene, counts, problem = self._scene, self._found.counts, self._problem
        orders = assignments(triples.shape[1])
        at = place_on_atlas(scene.points[triples], scene.normals[triples], problem, orders).best()
        ordered = triples[:, orders].reshape(-1, triples.shape[1])
        counts["assignments_tried"] += len(ordered)
        loads = loads_on(at, problem)
        for k in np.flatnonzero(loads >= self._settings.least_load):
            counts["placed_by_atlas"] += 1
            q = problem.tree.home.copy()
            q[problem.tree.arm :] = hand_atlas(problem.cell).joints[at.which[k]]
            placement = self._reach(q, at.rotations[k], at.positions[k])
            if placement is not None:
                counts["reached_by_arm"] += 1
                there = replace(problem, target=target_at(problem.target, placement))
                yield PlacedPosture(q, there, float(loads[k]), ordered[at.triple[k]], placement)

    def _reach(self, q: Array, R: Array, p: Array) -> Array | None:
        """Draw a placement (x m, y m, yaw rad) at which the arm reaches the palm pose; write the arm into `q`."""
        low, high = np.array(REACH).T
        for u in self._rng.random((PLACEMENTS, 3)):
            x, y = low + u[:2] * (high - low)
            placement = np.array([x, y, 2.0 * np.pi * u[2] - np.pi])
            turned = about_z(placement[2])
            if reach_palm(q, turned @ R, turned @ p + np.array([x, y, 0.0]), self._planner.tree):
                return placement
        return None

    def _add(self, candidate: Candidate) -> None:
        start, solution, hold = candidate
        assert isinstance(start, PlacedPosture)  # as all that are tried here
        (x, y, yaw), settings, tree = start.placement, self._planner.settings, self._planner.tree
        at, back, shift = solution.evaluation, about_z(-yaw), np.array([x, y, 0.0])
        palm_R, palm_p = palm_frame(solution.q, tree)
        level = level_of(load_of(hold.contacts, hold.forces), settings)
        clearances = at.values[fixed_rows(len(at.contacts))[-1] :]
        self._use[start.triple] += 1
        self._found.counts["feasible"] += 1
        self._found.counts["holding"] += level != NONE
        self._found.grasps.append(Fields(
            q=solution.q, placement=start.placement, triple=start.triple,
            contacts=(at.contacts - shift) @ back.T, normals=at.normals @ back.T, forces=hold.forces[:, :3] @ back.T,
            palm_position=back @ (palm_p - shift), palm_rotation=back @ palm_R,
            margin=at.margin, distances=at.distances - settings.tip_radius,
            clearance=min(FAR, float(clearances.min()) + settings.clearance) if len(clearances) else FAR,
            joint_margin=float(np.minimum(solution.q - tree.lower, tree.upper - solution.q).min()),
            load=level, torque_fraction=torque_fraction(hold.contacts, hold.forces),
        ))  # fmt: skip


def _draw(own: Triples, left: Mask, use: Array, rng: np.random.Generator) -> Index:
    """Draw triples without replacement, weight 1 / (1 + uses of its points)^2 (exponential keys)."""
    ids = np.flatnonzero(left)
    uses = sum(use[own[:, corner][ids]] for corner in range(own.shape[1]))
    keys = rng.exponential(size=len(ids)) * (1.0 + uses) ** 2
    least = np.argpartition(keys, BATCH)[:BATCH] if len(keys) > BATCH else np.arange(len(keys))
    return ids[least[np.argsort(keys[least])]]


def bearable(scene: RestScene, triples: Triples, settings: DatasetSettings) -> Triples:
    """Return the triples with the required closure margin at which forces up to `MOST_FORCE` can bear the object."""
    target, least = scene.grasp_target, settings.least_load
    planner = settings.planner.for_hand(settings.cell.robot.hand)
    shape = planner.proposed
    friction = np.full(shape.contacts, planner.friction_squeeze)
    loads = _free_loads(
        scene.points, scene.normals, friction, triples, target.centre, target.weight, least, shape
    )
    firm = triples[loads >= least]
    margins = margins_to(scene.points[firm], scene.normals[firm], planner.friction, shape, _ROUGH, 0.0)
    return firm[margins >= planner.closure_margin]


@njit
def _free_loads(
    points: Array, normals: Array, friction: Array, triples: Triples, centre: Array, gravity: Array,
    most: float, shape: Shape,
) -> Array:  # fmt: skip
    """Return loads (M,) of triples, up to `most`, for a hand whose contacts have an independent joint for each axis."""
    n, parts = shape.contacts, len(shape.model.parts)
    J, limit = np.eye(n * parts).reshape(n, parts, n * parts), np.full(n * parts, MOST_FORCE)
    room, out = empty_room(shape, n * parts), np.empty(len(triples))
    for m in range(len(triples)):
        t = triples[m]
        contacts = Contacts(points[t], normals[t], J, limit, friction, centre, gravity, shape.model)
        out[m] = squeeze_estimate(contacts, most, room)
    return out


def level_of(load: float, settings: PlannerSettings) -> int:
    """Return the index of the first of `settings.loads` that a load reaches, `NONE` if it reaches none."""
    reached = (load >= share * (1.0 + disturbance) - 1e-6 for share, disturbance in settings.loads)
    return next((level for level, held in enumerate(reached) if held), NONE)
