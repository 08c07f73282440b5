"""Step 5 of section 1.3: finger assignments and kinematics of a varied sample of feasible triples.

Triples are drawn with a probability inverse to how often their points are used in grasps found so far, so that
grasps cover the object. Those at which no fingers could bear it are left out. Each other is tried with all six
assignments; each assignment that the hand's atlas can place, and whose squeeze is estimated to bear the object there,
gets a random placement of the object before the robot, arm and hand, and the bilevel optimisation.
"""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dexgrasp.dataset.rest_scene import RestScene, placed, rest_scene, rng_of, turn
from dexgrasp.dataset.settings import DatasetSettings
from dexgrasp.kinematics.palm_ik import palm_frame, reach_palm
from dexgrasp.kinematics.tree import RobotTree, robot_tree
from dexgrasp.physics.margin import rough_margins
from dexgrasp.physics.squeeze import empty_room, squeeze_estimate
from dexgrasp.physics.strength import GRAVITY, load_of, torque_fraction
from dexgrasp.planning.atlas import hand_atlas
from dexgrasp.planning.claims import FAR
from dexgrasp.planning.constraints import FIXED_ROWS
from dexgrasp.planning.holding import NONE, firmest_hold, level_of
from dexgrasp.planning.placement import ASSIGNMENTS, place_on_atlas
from dexgrasp.planning.postures import loads_on
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.planning.sqp import Solution, solve
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import matrix_to_quat
from dexgrasp_env.robot.cell import Cell

BATCH = 128  # triples drawn at once
PLACEMENTS = 3  # placements tried until the arm reaches
REACH = ((0.40, 0.60), (-0.15, 0.15))  # m, where objects are put, x and y
MOST_FORCE = 15.0  # N along each axis: a finger's 0.7 Nm over the shortest lever that any posture has
_ROUGH = 1e-2  # of the margin
COUNTS = ("triples_tried", "assignments_tried", "placed_by_atlas", "reached_by_arm", "feasible", "holding")


@dataclass
class Found:
    """Grasps of a shard as they are found, one list a field, and the counts of the way there."""

    fields: dict[str, list[NDArray[Any]]] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    blocked: Counter[str] = field(default_factory=Counter)

    def add(self, **values: NDArray[Any] | float) -> None:
        """Append one grasp."""
        for name, value in values.items():
            self.fields.setdefault(name, []).append(np.asarray(value))

    def __len__(self) -> int:
        """Grasps found."""
        return self.counts["feasible"]


def sample_shard(target: str, pose: int, chunk: int, settings: DatasetSettings) -> Found:
    """Find the grasps of one shard; the same for the same settings, on any machine with the same versions."""
    scene, found = rest_scene(target, pose, settings), Found()
    rng = rng_of(settings, scene.name, pose, 1 + chunk)
    own = scene.triples[rng_of(settings, scene.name, pose, 0).permutation(len(scene.triples))][
        chunk :: settings.chunks
    ]
    own = np.asfortranarray(own)  # a corner's column is gathered from at every draw
    left, use, quota = np.ones(len(own), bool), np.zeros(len(scene.points)), settings.quota(chunk)
    cell, budget = settings.cell, settings.tries * quota
    while left.any() and len(found) < quota and found.counts["placed_by_atlas"] < budget:
        drawn = _draw(own, left, use, rng)
        left[drawn] = False
        found.counts["triples_tried"] += len(drawn)
        likely = bearable(scene, own[drawn], settings)
        if len(likely):
            _try(scene, likely, use, found, quota, cell, settings, rng)
    if len(found):  # all at once: one costs as much as a hundred
        found.fields["palm_quat_wxyz"] = list(matrix_to_quat(np.array(found.fields.pop("palm_rotation"))))
    return found


def _draw(
    own: NDArray[np.int32], left: NDArray[np.bool_], use: Array, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Draw triples without replacement, weight 1 / (1 + uses of its points)^2 (exponential keys)."""
    ids = np.flatnonzero(left)
    uses = sum(use[own[:, corner][ids]] for corner in range(3))
    keys = rng.exponential(size=len(ids)) * (1.0 + uses) ** 2
    least = np.argpartition(keys, BATCH)[:BATCH] if len(keys) > BATCH else np.arange(len(keys))
    return ids[least[np.argsort(keys[least])]]


def bearable(scene: RestScene, triples: NDArray[np.int32], settings: DatasetSettings) -> NDArray[np.int32]:
    """Return the triples that have the margin asked for, and at which some forces of `MOST_FORCE` bear the object."""
    target, least, planner = scene.grasp_target, settings.least_load, settings.planner
    gravity = np.array([0.0, 0.0, -GRAVITY * target.mass])
    loads = _free_loads(scene.points, scene.normals, scene.friction, triples, target.centre, gravity, least)
    firm = triples[loads >= least]
    margins = rough_margins(scene.points[firm], scene.normals[firm], planner.friction, _ROUGH)
    return firm[margins >= planner.closure_margin]


@njit(cache=True, error_model="numpy")
def _free_loads(
    points: Array, normals: Array, friction: Array, triples: NDArray[np.int32], centre: Array, gravity: Array,
    most: float,
) -> Array:  # fmt: skip
    """Loads (M,) of triples, up to `most`, if each contact were pushed along each axis by a joint of its own."""
    J, limit, room, out = np.zeros((3, 3, 9)), np.full(9, MOST_FORCE), empty_room(9), np.empty(len(triples))
    for k in range(9):
        J[k // 3, k % 3, k] = 1.0
    for m in range(len(triples)):
        t = triples[m]
        out[m] = squeeze_estimate(points[t], normals[t], centre, gravity, friction[t], J, limit, most, room)
    return out


def _try(
    scene: RestScene, triples: NDArray[np.int32], use: Array, found: Found, quota: int, cell: Cell,
    settings: DatasetSettings, rng: np.random.Generator,
) -> None:  # fmt: skip
    """Try all six assignments of some triples where the hand is likely to bear the object; add what is feasible."""
    tree, joints = robot_tree(cell), hand_atlas(cell).joints
    obstacle, planner = scene.grasp_target.distance.obstacle, settings.planner
    at = place_on_atlas(
        scene.points[triples], scene.normals[triples], obstacle, planner, ASSIGNMENTS, cell
    ).best()
    ordered = triples[:, ASSIGNMENTS].reshape(-1, 3)
    found.counts["assignments_tried"] += len(ordered)
    loads = loads_on(at, scene.grasp_target, cell, planner, scene.friction[ordered])
    for k in np.flatnonzero(loads >= settings.least_load):
        if len(found) >= quota:
            return
        found.counts["placed_by_atlas"] += 1
        q = tree.home.copy()
        q[tree.arm :] = joints[at.which[k]]
        placement = _reach(q, at.rotations[k], at.positions[k], tree, rng)
        if placement is None:
            continue
        found.counts["reached_by_arm"] += 1
        grasp_target = placed(scene.grasp_target, placement)
        solution = solve(q, cell, grasp_target, planner)
        if not solution.feasible:
            found.blocked[str(solution.blocking).split(":")[0]] += 1
            continue
        use[ordered[at.triple[k]]] += 1
        found.counts["feasible"] += 1
        _add(solution, placement, ordered[at.triple[k]], grasp_target, tree, planner, found)


def _reach(q: Array, R: Array, p: Array, tree: RobotTree, rng: np.random.Generator) -> Array | None:
    """Put the object where the arm reaches the palm's pose; return x, y, yaw, and the arm's joints in `q`."""
    tries = rng.random((PLACEMENTS, 3))
    for u in tries:
        placement = np.array([
            REACH[0][0] + u[0] * (REACH[0][1] - REACH[0][0]), REACH[1][0] + u[1] * (REACH[1][1] - REACH[1][0]),
            2.0 * np.pi * u[2] - np.pi,
        ])  # fmt: skip
        turned = turn(placement[2])
        if reach_palm(q, turned @ R, turned @ p + np.array([placement[0], placement[1], 0.0]), tree):
            return placement
    return None


def _add(
    solution: Solution, placement: Array, triple: NDArray[np.int32], grasp_target: GraspTarget, tree: RobotTree,
    settings: PlannerSettings, found: Found,
) -> None:  # fmt: skip
    at, back = solution.evaluation, turn(-placement[2])
    shift = np.array([placement[0], placement[1], 0.0])
    palm_R, palm_p = palm_frame(solution.q, tree)
    hold = firmest_hold(solution.q, grasp_target, tree, settings)
    level = level_of(load_of(hold.contacts, hold.forces), settings)
    found.counts["holding"] += level != NONE
    clearances = at.values[FIXED_ROWS:]
    found.add(
        q=solution.q, placement=placement, triple=triple,
        contacts=(at.contacts - shift) @ back.T, normals=at.normals @ back.T, forces=hold.forces @ back.T,
        palm_position=back @ (palm_p - shift), palm_rotation=back @ palm_R,
        margin=at.margin, distances=at.distances - settings.tip_radius,
        clearance=min(FAR, float(clearances.min()) + settings.clearance) if len(clearances) else FAR,
        joint_margin=float(np.minimum(solution.q - tree.lower, tree.upper - solution.q).min()),
        load=level, torque_fraction=torque_fraction(hold.contacts, hold.forces),
    )  # fmt: skip
