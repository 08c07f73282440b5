"""Are objects that touch or are stacked told apart, or said doubtful, and is one that is alone one?

    python scripts/parted_clouds.py OUT [--seed 0] [--count 200] [--kinds touching stacked] [--sensor captured]

Scenes of one or two objects of the catalogue are drawn and seen by one camera, as captures are, whose noise has holes,
flying pixels and steps of depth (`SensorModel.captured`): `single`, `touching` (gaps of 0 to 3 mm), `near` (3 to 20 mm)
and `stacked`; every other pair stands flush, side to side. An object is good where one of the things found holds 0.9
of its points, and 0.9 of the points of that are its own. Rows go to OUT/rows.jsonl; printed is for each kind how many
objects are good, how many that are not are said doubtful, and how many that are good are said doubtful nevertheless.
"""

import json
import sys
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.random import Generator
from scipy.spatial import ConvexHull
from tqdm import tqdm

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.errors import unknown_name
from dexgrasp_env.objects.load import load_target, resolve_targets
from dexgrasp_env.objects.rest_poses import rest_poses
from dexgrasp_env.perception.cloud import Cloud, gather, remove_flying
from dexgrasp_env.perception.pipeline import stand_on
from dexgrasp_env.perception.reasons import NoTargetError
from dexgrasp_env.perception.refinement import refine_instances
from dexgrasp_env.perception.scan import cloud_of
from dexgrasp_env.poses import about_z, quat_to_matrix
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.sensing.raycast import RayCameras
from dexgrasp_env.sensing.sensor import SensorModel
from dexgrasp_env.tasks.arrangement import gap_between
from dexgrasp_env.valid import Natural

KINDS = {"single": None, "touching": (0.0, 0.003), "near": (0.003, 0.02), "stacked": None}
GOOD = 0.9  # share and purity
_FLAT, _TOP = 0.001, 0.0012  # m below the top that is flat; m2 of it that carries another
_LENS = CameraIntrinsics(480, 360, 435.0, 435.0, 239.5, 179.5)
_LEAST = 200  # points of an object that is seen


class Body(NamedTuple):
    """A mesh at its place: corners (V, 3) m, world frame, and faces (F, 3)."""

    corners: Array
    faces: Index

    def moved(self, by: Any) -> "Body":
        """Return it elsewhere."""
        return self._replace(corners=self.corners + by)

    def squared(self) -> "Body":
        """Return it turned so that the smallest rectangle around it lies along x and y."""
        edges = np.diff(self.outline, axis=0, append=self.outline[:1])
        turned = [about_z(-angle)[:3, :3] for angle in np.arctan2(*edges.T[::-1])]
        return self._replace(
            corners=min((self.corners @ R.T for R in turned), key=lambda c: np.ptp(c[:, :2], axis=0).prod())
        )

    @property
    def outline(self) -> Array:
        """Its convex outline from above (n, 2) m."""
        return ring(self.corners[:, :2])

    @property
    def top(self) -> Array:
        """Corners (n, 2) m of its flat top."""
        return self.corners[self.corners[:, 2] > self.corners[:, 2].max() - _FLAT, :2]


def ring(flat: Array) -> Array:
    """Return the convex outline of points (N, 2)."""
    return flat[ConvexHull(flat).vertices]


def body(name: str, rng: Generator) -> Body:
    """Return an object at rest at the origin, one of its rest poses, turned about the vertical."""
    shape = load_target(name)
    poses = rest_poses(shape)
    chosen = poses[
        rng.choice(len(poses), p=np.array([p.probability for p in poses]) / sum(p.probability for p in poses))
    ]
    R = about_z(rng.uniform(0.0, 2.0 * np.pi))[:3, :3] @ quat_to_matrix(np.array(chosen.quat_wxyz))
    corners = shape.solid.vertices @ R.T
    return Body(corners - [0.0, 0.0, corners[:, 2].min()], shape.solid.faces)


def drawn(kind: str, names: list[str], rng: Generator) -> list[Body]:
    """Draw a scene around (0.5, 0) m."""
    first, flush = body(rng.choice(names), rng), rng.random() < 0.5
    if kind == "single":
        return [first.moved([0.5, 0.0, 0.0])]
    if kind == "stacked":
        while (
            len(first.top) < 3
            or np.linalg.matrix_rank(first.top - first.top[0], 1e-4) < 2
            or _area(first.top) < _TOP
        ):
            first = body(rng.choice(names), rng)
        other = body(rng.choice(names), rng)
        middle = 0.5 * (other.corners.max(0) + other.corners.min(0))
        place = first.top.mean(0) + rng.uniform(-0.01, 0.01, 2) - middle[:2]
        other = other.moved([*place, first.corners[:, 2].max()])
    else:
        other, gap, angle = (
            body(rng.choice(names), rng),
            rng.uniform(*KINDS[kind]),
            rng.uniform(0.0, 2.0 * np.pi),
        )
        if flush:
            first, other, angle = first.squared(), other.squared(), 0.5 * np.pi * rng.integers(4)
        way, step = np.array([np.cos(angle), np.sin(angle)]), 0.0
        while (short := gap - gap_between(other.outline + step * way, first.outline)) > 1e-5:
            step += max(short, 1e-4)
        other = other.moved([*(step * way), 0.0])
    turn = about_z(rng.uniform(0.0, 2.0 * np.pi))[:3, :3].T
    first, other = (one._replace(corners=one.corners @ turn) for one in (first, other))
    middle = np.concatenate([first.corners, other.corners])[:, :2].mean(0)
    return [one.moved([0.5 - middle[0], -middle[1], 0.0]) for one in (first, other)]


def _area(flat: Array) -> float:
    return float(ConvexHull(flat).volume)


def seen(bodies: list[Body], rng: Generator, sensor: SensorModel) -> tuple[Cloud, Index]:
    """Return a cloud, frame of the base, camera unknown, and which body each point shows, from 1 on, 0 the table."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.6, 0.8, 0.02], pos=[0.55, 0.0, -0.02])
    for k, one in enumerate(bodies):
        spec.add_mesh(name=str(k), uservert=one.corners.ravel(), userface=one.faces.ravel())
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=str(k))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    angle, rise, far = (
        rng.uniform(0.0, 2.0 * np.pi),
        np.radians(rng.uniform(25.0, 60.0)),
        rng.uniform(0.6, 0.9),
    )
    way = np.array([np.cos(rise) * np.cos(angle), np.cos(rise) * np.sin(angle), np.sin(rise)])
    eye = (Camera.look_at("eye", np.array([0.5, 0.0, 0.05]) + far * way, [0.5, 0.0, 0.05], _LENS),)
    rays, believed = RayCameras(model, eye), sensor.calibrate(eye, rng)
    cloud = gather(remove_flying(sensor.measure(rays.render(data), eye, rng)), believed)
    return cloud.moved(cloud.points - default_cell().base), rays.segment(data).ravel()[cloud.pixel]


def judged(cloud: Cloud, truth: Index, seed: int) -> list[dict[str, Any]]:
    """Return for each object that is seen its share and purity, and whether the thing that holds it is doubtful."""
    try:
        _, support, above, _ = stand_on(cloud_of(cloud.points), np.random.default_rng(seed), default_cell())
    except NoTargetError as none:
        return [{"reason": none.reason, "good": False, "doubt": "refused"}]
    instances = refine_instances(above, support.cloud, support.plane)
    of, rows = truth[above.pixel], []
    objects = instances.objects(above)
    for k in np.unique(of[of > 0]):
        mine = of == k
        if mine.sum() < _LEAST:
            continue
        best = np.bincount(instances.labels[mine]).argmax()
        both = (mine & (instances.labels == best)).sum()
        share, purity = both / mine.sum(), both / (instances.labels == best).sum()
        doubts = [
            instances.doubts[j]
            for j in np.unique(instances.labels[mine])
            if j in objects and instances.doubts[j]
        ]
        rows.append(
            {"object": int(k), "share": share, "purity": purity, "things": len(objects),
             "good": bool(min(share, purity) >= GOOD), "doubt": "; ".join(doubts)}
        )  # fmt: skip
    return rows


class Parted(Script):
    """Tries scenes of each kind, and says how many objects are told apart, or said doubtful.

    Attributes:
        out: folder of the rows.
        seed: of the scenes.
        count: of each kind.
        kinds: of scenes.
        objects: that are drawn.
        sensor: a name of `SENSORS`.
    """

    out: Argument[Folder]
    seed: Natural = 0
    count: Natural = 200
    kinds: tuple[str, ...] = tuple(KINDS)
    objects: tuple[str, ...] = ("all20",)
    sensor: str = "captured"

    def run(self) -> int:
        for kind in self.kinds:
            if kind not in KINDS:
                raise unknown_name("kind", kind, KINDS)
        names, sensor = list(resolve_targets(self.objects)), SensorModel.of(self.sensor)
        self.out.mkdir(parents=True, exist_ok=True)
        with (self.out / "rows.jsonl").open("w") as file:
            for kind in self.kinds:
                rows = []
                for k in tqdm(range(self.count), desc=kind, disable=None):
                    rng = np.random.default_rng([self.seed, list(KINDS).index(kind), k])
                    found = judged(*seen(drawn(kind, names, rng), rng, sensor), k)
                    rows += found
                    for row in found:
                        print(json.dumps({"kind": kind, "scene": k} | row), file=file)
                good = [row for row in rows if row["good"]]
                bad = [row for row in rows if not row["good"]]
                said, false = (sum(bool(row["doubt"]) for row in part) for part in (bad, good))
                print(
                    f"{kind}: {len(good)} of {len(rows)} good, {said} of {len(bad)} others said doubtful: "
                    f"{100 * (len(good) + said) / max(len(rows), 1):.0f} % good or said; "
                    f"{false} of {len(good)} good ones said doubtful"
                )
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Parted))
