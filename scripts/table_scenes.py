"""Bodies on a table, as cameras see them, and the rows of what was tried: for scripts that judge clouds."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
from numpy.random import Generator
from scipy.spatial import ConvexHull
from tqdm import tqdm

from dexgrasp_env.arrays import Array, Fields, Index
from dexgrasp_env.perception.cloud import Cloud, gather, remove_flying
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.sensing.raycast import RayCameras
from dexgrasp_env.sensing.sensor import SensorModel


class Body(NamedTuple):
    """A mesh at its place: corners (V, 3) m, world frame, and faces (F, 3)."""

    corners: Array
    faces: Index

    def moved(self, by: Any) -> "Body":
        """Return it elsewhere."""
        return self._replace(corners=self.corners + by)

    @property
    def outline(self) -> Array:
        """Its convex outline from above (n, 2) m."""
        flat = self.corners[:, :2]
        return flat[ConvexHull(flat).vertices]


def bare_table() -> mujoco.MjSpec:
    """Return a scene of a wide table alone, whose top is z = 0."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.6, 0.8, 0.02], pos=[0.55, 0.0, -0.02])
    return spec


def seen(
    bodies: Sequence[Body], cameras: tuple[Camera, ...], sensor: SensorModel, rng: Generator
) -> tuple[Cloud, Index]:
    """Return a cloud, frame of the base, and which body each point shows, from 1 on, 0 the table."""
    spec = bare_table()
    for k, one in enumerate(bodies):
        spec.add_mesh(name=str(k), uservert=one.corners.ravel(), userface=one.faces.ravel())
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=str(k))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    rays, believed = RayCameras(model, cameras), sensor.calibrate(cameras, rng)
    cloud = gather(remove_flying(sensor.measure(rays.render(data), cameras, rng)), believed)
    return cloud.moved(cloud.points - default_cell().base), rays.segment(data).ravel()[cloud.pixel]


def written(out: Path, rows: Iterable[Fields], total: int | None = None) -> list[Fields]:
    """Write rows to OUT/rows.jsonl as they come, behind a bar; return them."""
    out.mkdir(parents=True, exist_ok=True)
    found = []
    with (out / "rows.jsonl").open("w") as file:
        for row in tqdm(rows, total=total, disable=None):
            print(json.dumps(row), file=file, flush=True)
            found.append(row)
    return found
