"""Judge plans and segmentation on clouds of tables with several objects.

    python scripts/clouds.py crowded OUT [--seed 0] [--count 40]
    python scripts/clouds.py parted OUT [--seed 0] [--count 200] [--kinds touching stacked] [--sensor captured]

`crowded`: does the robot hit what stands beside the object that is pointed at? Tables of boxes, cans and walls are seen
by four cameras of the usual noise; those that users brought (crowded.yaml), then --count that are drawn. Each cloud
goes through `dexgrasp plan --cloud`, told by a point, a box or a mask in turn, `export` and `check`. The exported rows
are then played, every 20 ms, against the true shapes: the robot's and the carried object's distance to all that was not
pointed at. Exits with 1 where an unrefused trajectory hits anything by more than a millimetre.

`parted`: are objects that touch or are stacked separated, or reported as doubtful, and is a single one found whole?
Scenes of one or two objects of the catalogue are drawn and seen by one camera, whose noise is that of captures: holes,
flying pixels and steps of depth (`SensorModel.captured`). Kinds are `single`, `touching` (gaps of 0 to 3 mm), `near` (3
to 20 mm) and `stacked`; every other pair stands flush, side to side. An object is good where one of the things found
holds 0.9 of its points, and 0.9 of the points of that are its own. The table has for each kind the number of good
objects, of others that are reported as doubtful, and of good ones that are reported as doubtful nevertheless.

Rows go to OUT/rows.jsonl.
"""

import contextlib
import io
import json
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import mujoco
import numpy as np
import trimesh
import yaml
from numpy.random import Generator
from scipy.spatial import ConvexHull
from tqdm import tqdm

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.cli.main import main as dexgrasp
from dexgrasp.export.read import read_trajectory
from dexgrasp.grasp.verify.scene import Scene
from dexgrasp_env.arrays import Array, Fields, Index
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
from dexgrasp_env.valid import Natural, one_of

HIT = -0.001  # m
WAYS = ("--object-near", "--box", "--mask")
KINDS = {"single": (), "touching": (0.0, 0.003), "near": (0.003, 0.02), "stacked": ()}
GOOD = 0.9  # share and purity
_LENS = CameraIntrinsics(480, 360, 435.0, 435.0, 239.5, 179.5)
_LEAST = 200  # points of an object that is seen


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


def seen(
    bodies: Sequence[Body], cameras: tuple[Camera, ...], sensor: SensorModel, rng: Generator
) -> tuple[Cloud, Index]:
    """Return a cloud, frame of the base, and which body each point shows, from 1 on, 0 the table, at z = 0."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.6, 0.8, 0.02], pos=[0.55, 0.0, -0.02])
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


# -- crowded -----------------------------------------------------------------------------------------------------------


def thing(sides: Any, place: Any, yaw: float = 0.0, can: bool = False) -> Body:
    """Return a box or a can on the table: sides (3,) m, two diameters and the height of a can; middle (2,) m."""
    solid = trimesh.creation.cylinder(sides[0] / 2, sides[2]) if can else trimesh.creation.box(sides)
    R = about_z(yaw)[:3, :3]
    return Body(solid.vertices @ R.T + [*place, sides[2] / 2], np.array(solid.faces))


def bin_around(low: Any, high: Any, height: float) -> list[Body]:
    """Return the four walls, 8 mm thick, of an open bin between two corners (2,) m."""
    (x, y), (a, b) = 0.5 * np.add(low, high), np.subtract(high, low)
    across = [thing((0.008, b, height), (x + s * a / 2.0, y)) for s in (-1, 1)]
    return [*across, *(thing((a, 0.008, height), (x, y + s * b / 2.0)) for s in (-1, 1))]


def users() -> dict[str, list[Body]]:
    """Return the scenes that users brought; the first thing is the one that is meant."""
    tables = yaml.safe_load(Path(__file__).with_name("crowded.yaml").read_text())
    return {
        name: [body for one in things for body in (bin_around(**one) if "height" in one else [thing(**one)])]
        for name, things in tables.items()
    }


def crowd(rng: Generator) -> list[Body]:
    """Draw a scene: one to five things beside the first, 0.5 to 8 cm away, or a bin around all."""
    things = [_thing(rng).moved([rng.uniform(0.45, 0.58), rng.uniform(-0.12, 0.12), 0.0])]
    for angle in rng.permutation(6)[: rng.integers(1, 6)] * np.pi / 3.0 + rng.uniform(0.0, 1.0):
        other, gap = _thing(rng), np.exp(rng.uniform(np.log(0.005), np.log(0.08)))
        for step in np.arange(0.03, 0.30, 0.002):
            middle = 0.5 * (things[0].corners.min(0) + things[0].corners.max(0))
            moved = other.moved([*(middle[:2] + step * np.array([np.cos(angle), np.sin(angle)])), 0.0])
            if min(gap_between(moved.outline, one.outline) for one in things) >= gap:
                things.append(moved)
                break
    if rng.random() < 0.25:
        corners = np.concatenate([one.outline for one in things])
        room = rng.uniform(0.02, 0.08, 4)
        things += bin_around(corners.min(0) - room[:2], corners.max(0) + room[2:], rng.uniform(0.04, 0.10))
    return things


def _thing(rng: Generator) -> Body:
    can = bool(rng.random() < 0.4)
    a, b, c = rng.uniform((0.04, 0.04, 0.05), (0.075, 0.11, 0.18))
    return thing((a, a if can else b, c), (0.0, 0.0), rng.uniform(0.0, np.pi), can)


def run(*argv: str) -> tuple[int, str]:
    """Run a command; return its exit code, and what it says."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = dexgrasp(argv)
    return code, said.getvalue().strip()


def target_options(way: str, target: Body, labels: Array, folder: Path) -> list[str]:
    """Return the options that point at a body."""
    low, high = (end(target.corners, axis=0) - default_cell().base for end in (np.min, np.max))
    if way == "--mask":
        np.save(folder / "mask.npy", labels == 1)
        return [way, str(folder / "mask.npy")]
    places = 0.5 * (low + high) if way == "--object-near" else np.concatenate([low - 0.004, high + 0.004])
    return [way, *(f"{value:.4f}" for value in places)]


def tried(name: str, things: list[Body], way: str, seed: list[int], folder: Path) -> Fields:
    """Plan for the first of the things, export, check, and look how near the rows come to the others."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    cloud, labels = seen(things, default_cell().make_cameras(), SensorModel.realistic(), rng)
    np.save(folder / "cloud.npy", cloud.points)
    rows, options = folder / "rows", target_options(way, things[0], labels, folder)
    code, said = run("plan", "--cloud", str(folder / "cloud.npy"), *options, "--out", str(folder))
    row = {"scene": name, "way": way, "plan": code, "doubtful": "doubt:" in said}
    command = "plan"
    if not code:
        command = "export"
        code, said = run("export", str(folder / "grasp.json"), "--out", str(rows))
    if code:
        return row | {"came": f"refused by {command}", "said": said.rpartition("\n")[2]}
    code, _ = run("check", str(rows))
    gap = clearance(rows, things)
    came = "clear" if gap > HIT else "hit"
    return row | {"check": code, "clearance": gap, "came": came if code == 0 else f"{came}, refused by check"}


def clearance(rows: Path, things: list[Body]) -> float:
    """Return how near, m, robot and carried object come to all things but the first."""
    cell = default_cell()
    recording = read_trajectory(rows, cell)
    scene = Scene(cell, [things[0].corners], (), [one.corners for one in things[1:]])
    times = np.arange(0.0, recording.arm.times[-1], 0.02)
    path, start = recording.at(times), recording.facts.segments["lift"].start
    robot = min(scene.clearances(q, tips_touch=False)["hand_neighbour"] for q in path)
    scene.place(path[times < start][-1])
    return float(min(robot, scene.carried(path[times >= start])[1]))


class Crowded(Script):
    """Try all crowded scenes; exit code 1 if a trajectory hits anything."""

    out: Argument[Folder]
    seed: Natural = 0
    count: Natural = 40

    def run(self) -> int:
        scenes = users()
        scenes |= {f"drawn {k}": crowd(np.random.default_rng([self.seed, k])) for k in range(self.count)}
        rows = (
            tried(name, things, WAYS[k % len(WAYS)], [self.seed, k, 1], self.out / name.replace(" ", "_"))
            for k, (name, things) in enumerate(scenes.items())
        )
        found = written(self.out, rows, len(scenes))
        for name, count in sorted(Counter(row["came"] for row in found).items()):
            print(f"{name}: {count} of {len(found)}")
        return int(any(row["came"] == "hit" for row in found))


# -- parted ------------------------------------------------------------------------------------------------------------


def squared(one: Body) -> Body:
    """Return it turned so that the smallest rectangle around it lies along x and y."""
    edges = np.diff(one.outline, axis=0, append=one.outline[:1])
    turned = (one.corners @ about_z(-angle)[:3, :3].T for angle in np.arctan2(*edges.T[::-1]))
    return one._replace(corners=min(turned, key=lambda c: np.ptp(c[:, :2], axis=0).prod()))


def top_of(one: Body) -> Array | None:
    """Return the corners (n, 2) m of a flat top of 12 cm2 and more, which carries another body; None for others."""
    flat = one.corners[one.corners[:, 2] > one.corners[:, 2].max() - 0.001, :2]
    if len(flat) < 3 or np.linalg.matrix_rank(flat - flat[0], 1e-4) < 2 or ConvexHull(flat).volume < 0.0012:
        return None
    return flat


def body(names: list[str], rng: Generator) -> Body:
    """Return an object at rest at the origin, one of its rest poses, turned about the vertical."""
    shape = load_target(rng.choice(names))
    poses = rest_poses(shape)
    odds = np.array([pose.probability for pose in poses])
    chosen = poses[rng.choice(len(poses), p=odds / sum(odds.tolist()))]
    R = about_z(rng.uniform(0.0, 2.0 * np.pi))[:3, :3] @ quat_to_matrix(np.array(chosen.quat_wxyz))
    corners = shape.solid.vertices @ R.T
    return Body(corners - [0.0, 0.0, corners[:, 2].min()], shape.solid.faces)


def pair(kind: str, names: list[str], rng: Generator) -> list[Body]:
    """Draw a scene of one or two objects around (0.5, 0) m."""
    first, flush = body(names, rng), rng.random() < 0.5
    if kind == "single":
        return [first.moved([0.5, 0.0, 0.0])]
    if kind == "stacked":
        while (top := top_of(first)) is None:
            first = body(names, rng)
        other = body(names, rng)
        middle = 0.5 * (other.corners.max(0) + other.corners.min(0))
        place = top.mean(0) + rng.uniform(-0.01, 0.01, 2) - middle[:2]
        other = other.moved([*place, first.corners[:, 2].max()])
    else:
        other = body(names, rng)
        gap, angle = rng.uniform(*KINDS[kind]), rng.uniform(0.0, 2.0 * np.pi)
        if flush:
            first, other, angle = squared(first), squared(other), 0.5 * np.pi * rng.integers(4)
        way, step = np.array([np.cos(angle), np.sin(angle)]), 0.0
        while (short := gap - gap_between(other.outline + step * way, first.outline)) > 1e-5:
            step += max(short, 1e-4)
        other = other.moved([*(step * way), 0.0])
    turn = about_z(rng.uniform(0.0, 2.0 * np.pi))[:3, :3].T
    first, other = (one._replace(corners=one.corners @ turn) for one in (first, other))
    middle = np.concatenate([first.corners, other.corners])[:, :2].mean(0)
    return [one.moved([0.5 - middle[0], -middle[1], 0.0]) for one in (first, other)]


def eye(rng: Generator) -> Camera:
    """Return a camera that looks down at the scene from anywhere around it."""
    angle, rise = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(25.0, 60.0))
    way = np.array([np.cos(rise) * np.cos(angle), np.cos(rise) * np.sin(angle), np.sin(rise)])
    centre = np.array([0.5, 0.0, 0.05])
    return Camera.look_at("eye", centre + rng.uniform(0.6, 0.9) * way, centre, _LENS)


def judged(cloud: Cloud, truth: Index, seed: int) -> list[Fields]:
    """Return for each object that is seen its share and purity, and whether the thing that holds it is doubtful."""
    try:
        _, support, above, _ = stand_on(cloud_of(cloud.points), np.random.default_rng(seed), default_cell())
    except NoTargetError as none:
        return [{"reason": none.reason, "good": False, "doubt": "refused"}]
    instances, of, rows = refine_instances(above, support.cloud, support.plane), truth[above.pixel], []
    objects = instances.objects(above)
    for k in np.unique(of[of > 0]):
        mine = of == k
        if mine.sum() < _LEAST:
            continue
        things = np.bincount(instances.labels[mine])
        best = instances.labels == things.argmax()
        share, purity = (mine & best).sum() / mine.sum(), (mine & best).sum() / best.sum()
        doubts = (instances.doubts[j] for j in np.flatnonzero(things) if j in objects)
        rows.append(
            {"object": int(k), "share": share, "purity": purity, "things": len(objects),
             "good": bool(min(share, purity) >= GOOD), "doubt": "; ".join(filter(None, doubts))}
        )  # fmt: skip
    return rows


class Parted(Script):
    """Try scenes of each kind; count objects that are separated or reported as doubtful.

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
    kinds: tuple[Annotated[str, one_of(KINDS)], ...] = tuple(KINDS)
    objects: tuple[str, ...] = ("all20",)
    sensor: str = "captured"

    def run(self) -> int:
        every = written(self.out, self._rows())
        for kind in self.kinds:
            rows = [row for row in every if row["kind"] == kind]
            good, bad = ([row for row in rows if row["good"] == whole] for whole in (True, False))
            said, false = (sum(bool(row["doubt"]) for row in part) for part in (bad, good))
            print(
                f"{kind}: {len(good)} of {len(rows)} good, {said} of {len(bad)} others said doubtful: "
                f"{100 * (len(good) + said) / max(len(rows), 1):.0f} % good or said; "
                f"{false} of {len(good)} good ones said doubtful"
            )
        return 0

    def _rows(self) -> Iterator[Fields]:
        names, sensor = list(resolve_targets(self.objects)), SensorModel.of(self.sensor)
        for kind in self.kinds:
            for k in range(self.count):
                rng = np.random.default_rng([self.seed, list(KINDS).index(kind), k])
                found = judged(*seen(pair(kind, names, rng), (eye(rng),), sensor, rng), k)
                yield from ({"kind": kind, "scene": k} | row for row in found)


if __name__ == "__main__":
    sys.exit(run_script({"crowded": Crowded, "parted": Parted}))
