"""Are objects that touch or are stacked told apart, or said doubtful, and is one that is alone one?

    python scripts/parted_clouds.py OUT [--seed 0] [--count 200] [--kinds touching stacked] [--sensor captured]

Scenes of one or two objects of the catalogue are drawn and seen by one camera, as captures are, whose noise has holes,
flying pixels and steps of depth (`SensorModel.captured`): `single`, `touching` (gaps of 0 to 3 mm), `near` (3 to 20 mm)
and `stacked`; every other pair stands flush, side to side. An object is good where one of the things found holds 0.9
of its points, and 0.9 of the points of that are its own. Rows go to OUT/rows.jsonl; printed is for each kind how many
objects are good, how many that are not are said doubtful, and how many that are good are said doubtful nevertheless.
"""

import sys
from collections.abc import Iterator
from typing import Annotated

import numpy as np
from numpy.random import Generator
from scipy.spatial import ConvexHull
from table_scenes import Body, seen, written

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.arrays import Array, Fields, Index
from dexgrasp_env.objects.load import load_target, resolve_targets
from dexgrasp_env.objects.rest_poses import rest_poses
from dexgrasp_env.perception.cloud import Cloud
from dexgrasp_env.perception.pipeline import stand_on
from dexgrasp_env.perception.reasons import NoTargetError
from dexgrasp_env.perception.refinement import refine_instances
from dexgrasp_env.perception.scan import cloud_of
from dexgrasp_env.poses import about_z, quat_to_matrix
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.sensing.sensor import SensorModel
from dexgrasp_env.tasks.arrangement import gap_between
from dexgrasp_env.valid import Natural, one_of

KINDS = {"single": (), "touching": (0.0, 0.003), "near": (0.003, 0.02), "stacked": ()}
GOOD = 0.9  # share and purity
_LENS = CameraIntrinsics(480, 360, 435.0, 435.0, 239.5, 179.5)
_LEAST = 200  # points of an object that is seen


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


def drawn(kind: str, names: list[str], rng: Generator) -> list[Body]:
    """Draw a scene around (0.5, 0) m."""
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
    kinds: tuple[Annotated[str, one_of(KINDS)], ...] = tuple(KINDS)
    objects: tuple[str, ...] = ("all20",)
    sensor: str = "captured"

    def run(self) -> int:
        every = written(self.out, self._rows(), None)
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
                found = judged(*seen(drawn(kind, names, rng), (eye(rng),), sensor, rng), k)
                yield from ({"kind": kind, "scene": k} | row for row in found)


if __name__ == "__main__":
    sys.exit(run_script(Parted))
