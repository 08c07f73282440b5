"""An object in one rest pose: surface points, every feasible contact triple, and its placement before the robot.

The **rest frame** has its origin on the table under the object's centre of mass, z up, and the yaw of
`RestPose.quat_wxyz`; any other placement is a turn about z and a shift in the plane.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from dexgrasp.data.dataset.settings import DatasetSettings
from dexgrasp.geometry.surface_samples import triangle_samples
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.proposals import LEAST_DISTANCE, closing_sets, graspable_points
from dexgrasp_env.arrays import Array
from dexgrasp_env.files import content_hash
from dexgrasp_env.objects.load import load_target, object_name
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.rest_poses import RestPose, rest_poses
from dexgrasp_env.poses import about_z, pose_matrix

Triples = NDArray[np.int32]
"""Indices (..., 3) of contacts; of a gripper pairs (..., 2)."""


@dataclass(frozen=True, eq=False)
class RestScene:
    """An object in a rest pose; lengths in m, rest frame.

    Attributes:
        name: of the object.
        pose: index of the rest pose, likeliest first.
        grasp_target: hull, distance, centre of mass and mass.
        rest: rest pose: rotation and height of the object's frame in the rest frame, probability when dropped.
        points: (N, 3) candidate contacts.
        normals: (N, 3) at the points, out of the object.
        triples: (M, 3) indices of all triples that can be in equilibrium.
        decided: number of triples that were tested.
        cloud: (2048, 6) points and normals of the hull, underside included.
    """

    name: str
    pose: int
    grasp_target: GraspTarget
    rest: RestPose
    points: Array
    normals: Array
    triples: Triples
    decided: int
    cloud: Array


def rng_of(settings: DatasetSettings, *key: int | str) -> np.random.Generator:
    """Return the random generator of a part of the dataset, which depends on the seed and the key only."""
    numbers = [int(content_hash(k), 16) if isinstance(k, str) else k for k in key]
    return np.random.default_rng(np.random.SeedSequence([settings.seed, *numbers]))


def model_of(target: str, settings: DatasetSettings) -> ObjectModel:
    """Return an object with the scale and the mass of the settings."""
    return load_target(target, settings.mesh_scale, settings.mesh_mass)


@lru_cache(maxsize=2)
def rest_scene(target: str, pose: int, settings: DatasetSettings) -> RestScene:
    """Prepare an object in a rest pose: steps 2 to 4 of section 1.3 of the supplement."""
    model = model_of(target, settings)
    rest, name = rest_poses(model)[pose], object_name(target)
    T = pose_matrix(np.array([0.0, 0.0, rest.height]), np.array(rest.quat_wxyz))
    mesh = model.mesh.copy().apply_transform(T)
    grasp_target = GraspTarget.of(mesh, mass=model.mass, centre=T[:3, 3].copy())
    rng = rng_of(settings, name, pose)
    points, normals = graspable_points(grasp_target, settings.planner, rng)
    pairs = len(settings.cell.robot.hand.grasp) == 2
    triples = np.zeros((0, 2 if pairs else 3), np.int32)
    if len(points) >= 3:
        own = Planner(settings.planner, cell=settings.cell).settings if pairs else settings.planner
        triples = closing_sets(points, normals, own)
    gaps = np.linalg.norm(points[:, None] - points[None], axis=-1) >= LEAST_DISTANCE
    decided = round(gaps.sum() / 2.0 if pairs else float(np.trace(gaps.astype(float) @ gaps @ gaps)) / 6.0)
    samples = triangle_samples(grasp_target.hull.triangles, 2048, rng)  # points kept for training
    cloud = np.concatenate([samples.points, samples.normals], axis=1)
    return RestScene(name, pose, grasp_target, rest, points, normals, triples, decided, cloud)


def target_at(grasp_target: GraspTarget, placement: Array) -> GraspTarget:
    """Return the target moved to a placement (x m, y m, yaw rad) for the optimiser, which uses distances only.

    NB: `hull` is not moved: that would cost more than solving.
    """
    R, shift = about_z(float(placement[2])), np.array([placement[0], placement[1], 0.0])
    old = grasp_target.distance
    planes = old.planes.copy()
    planes[:, :3] = planes[:, :3] @ R.T
    planes[:, 3] -= planes[:, :3] @ shift
    moved = replace(old, triangles=np.ascontiguousarray(old.triangles @ R.T + shift), planes=planes)
    return replace(grasp_target, distance=moved, centre=R @ grasp_target.centre + shift)
