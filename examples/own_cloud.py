"""A point cloud of your own, in metres in the robot's base frame: planned on without any file."""

import numpy as np
import trimesh

from dexgrasp import plan_cloud
from dexgrasp.geometry.request import GraspRequest


def scene(noise: float = 0.001) -> np.ndarray:
    """Return the points (N, 3) of a can on a table, as cameras above it see them."""
    rng = np.random.default_rng(0)
    place = trimesh.transformations.translation_matrix((0.52, 0.05, 0.05))
    can = trimesh.creation.cylinder(0.033, 0.10, transform=place)
    on_can, faces = trimesh.sample.sample_surface(can, 6000, seed=0)
    seen = on_can[can.face_normals[faces][:, 2] > -0.5]  # nobody sees the underside
    table = np.column_stack([rng.uniform(0.2, 0.8, 20000), rng.uniform(-0.4, 0.4, 20000), np.zeros(20000)])
    table = table[np.hypot(table[:, 0] - 0.52, table[:, 1] - 0.05) > 0.033]
    points = np.concatenate([seen, table])
    return points + rng.normal(0.0, noise, points.shape)


# Plan a grasp of the can and print its certificate.
found = plan_cloud(scene(), near=(0.52, 0.05, 0.05), request=GraspRequest(mass=0.3))
if found.grasp is None:
    raise SystemExit(found.reason)
certificate = found.grasp.certificate
print("closure margin:", certificate.closure_margin, "load:", certificate.load)
