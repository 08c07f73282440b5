"""Does the robot hit what stands beside the object that is pointed at in a cloud? Plan, export, check, then look.

    python scripts/crowded_clouds.py OUT [--seed 0] [--count 40]

Tables of boxes, cans and walls are seen by four cameras of the usual noise; the eight that users brought (gaps of 10,
5, 3 and 2 cm, four boxes around, five objects, a can in the middle of a bin and in its corner), then --count that are
drawn. Each cloud goes through `dexgrasp plan --cloud`, told by a point, a box or a mask in turn, `export` and `check`
with `--json`. The exported rows are then played, every 20 ms, against the true shapes: the robot's and the carried
object's distance to all that was not pointed at. Rows go to OUT/rows.jsonl; exits with 1 where an unrefused trajectory
hits anything by more than a millimetre.
"""

import contextlib
import io
import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.random import Generator
from tqdm import tqdm

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.cli.main import main as dexgrasp
from dexgrasp.export.read import read_trajectory
from dexgrasp.grasp.verify.scene import Scene
from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import gather, remove_flying
from dexgrasp_env.poses import about_z
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.sensing.raycast import RayCameras
from dexgrasp_env.sensing.sensor import SensorModel
from dexgrasp_env.valid import Natural

HIT = -0.001  # m
WAYS = ("--object-near", "--box", "--mask")


class Thing(NamedTuple):
    """A box or a can on the table: sides (3,) m, two diameters and the height of a can; middle (2,) m; yaw, rad."""

    sides: tuple[float, float, float]
    place: tuple[float, float]
    yaw: float = 0.0
    can: bool = False

    def corners(self) -> Array:
        """Return the corners (N, 3) m of its hull."""
        corners = np.arange(0.0, 2.0 * np.pi, np.pi / (24.0 if self.can else 2.0))
        level = _ring(corners) if self.can else np.sqrt(2.0) * _ring(corners + np.pi / 4.0)
        level = (0.5 * level * self.sides[:2]) @ about_z(self.yaw)[:2, :2].T
        return np.concatenate(
            [np.c_[level + self.place, np.full(len(level), z)] for z in (0.0, self.sides[2])]
        )


def _ring(angles: Any) -> Array:
    """Return unit vectors (..., 2) at angles (...), rad."""
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


CAN, BOX = (0.066, 0.066, 0.10), (0.04, 0.09, 0.17)


def beside(gap: float) -> list[Thing]:
    """Return a can and a box so far beside it."""
    return [Thing(CAN, (0.5, 0.0), can=True), Thing(BOX, (0.5, 0.033 + gap + 0.045))]


def bin_around(middle: tuple[float, float], sides: tuple[float, float], height: float) -> list[Thing]:
    """Return the four walls of an open bin, 8 mm thick."""
    (x, y), (a, b) = middle, sides
    return [Thing((0.008, b, height), (x + s * a / 2.0, y)) for s in (-1, 1)] + [
        Thing((a, 0.008, height), (x, y + s * b / 2.0)) for s in (-1, 1)
    ]


def users() -> dict[str, list[Thing]]:
    """Return the scenes that users brought; the first thing is the one that is meant."""
    around = [Thing((0.06, 0.06, 0.12), (0.5 + x, y)) for x, y in ((0.1, 0), (-0.1, 0), (0, 0.1), (0, -0.1))]
    five = [
        ((0.12, 0.08), BOX),
        ((-0.05, -0.13), CAN),
        ((0.1, -0.08), (0.05, 0.05, 0.05)),
        ((-0.08, 0.1), CAN),
    ]
    can = Thing(CAN, (0.5, 0.0), can=True)
    return {
        **{f"gap {100 * gap:g} cm": beside(gap) for gap in (0.10, 0.05, 0.03, 0.02)},
        "four boxes around": [can, *around],
        "five objects": [can, *(Thing(sides, (0.5 + x, y), 0.4, sides == CAN) for (x, y), sides in five)],
        "bin, middle": [can, *bin_around((0.5, 0.0), (0.30, 0.40), 0.08)],
        "bin, corner": [can, *bin_around((0.6, 0.11), (0.30, 0.32), 0.08)],
    }


def drawn(rng: Generator) -> list[Thing]:
    """Draw a scene: one to five things beside the first, 0.5 to 8 cm away, or a bin around all."""
    things = [_thing(rng, (rng.uniform(0.45, 0.58), rng.uniform(-0.12, 0.12)))]
    low, high = np.log(0.005), np.log(0.08)
    for angle in rng.permutation(6)[: rng.integers(1, 6)] * np.pi / 3.0 + rng.uniform(0.0, 1.0):
        other, gap = _thing(rng, (0.0, 0.0)), float(np.exp(rng.uniform(low, high)))
        way = _ring(angle)
        for step in np.arange(0.03, 0.30, 0.002):
            x, y = np.array(things[0].place) + step * way
            moved = other._replace(place=(float(x), float(y)))
            if min(_apart(moved, one) for one in things) >= gap:
                things.append(moved)
                break
    if rng.random() < 0.25:
        corners = np.concatenate([one.corners()[:, :2] for one in things])
        room = rng.uniform(0.02, 0.08, 4)
        low, high = corners.min(0) - room[:2], corners.max(0) + room[2:]
        middle, sides = 0.5 * (low + high), high - low
        things += bin_around((middle[0], middle[1]), (sides[0], sides[1]), rng.uniform(0.04, 0.10))
    return things


def _thing(rng: Generator, place: tuple[float, float]) -> Thing:
    can = bool(rng.random() < 0.4)
    a, b, c = rng.uniform((0.04, 0.04, 0.05), (0.075, 0.11, 0.18))
    return Thing((a, a if can else b, c), place, rng.uniform(0.0, np.pi), can)


def _apart(a: Thing, b: Thing) -> float:
    """Return the gap between outlines, m, at least: along normals of their sides."""
    one, other = a.corners()[:, :2], b.corners()[:, :2]
    ways = _ring(np.arange(0.0, np.pi, np.pi / 60.0)).T
    p, q = one @ ways, other @ ways
    return float(np.maximum(q.min(0) - p.max(0), p.min(0) - q.max(0)).max())


def bare_table() -> mujoco.MjSpec:
    """Return a scene of a wide table alone, whose top is z = 0."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.6, 0.8, 0.02], pos=[0.55, 0.0, -0.02])
    return spec


def seen(things: list[Thing], rng: Generator) -> tuple[Array, Array]:
    """Return a cloud (N, 3) m, frame of the base, and which thing each point shows, from 1 on, 0 the table."""
    cell, spec = default_cell(), bare_table()
    for one in things:
        size = [one.sides[0] / 2, one.sides[2] / 2, 0] if one.can else [side / 2 for side in one.sides]
        kind = mujoco.mjtGeom.mjGEOM_CYLINDER if one.can else mujoco.mjtGeom.mjGEOM_BOX
        turn = [np.cos(one.yaw / 2), 0, 0, np.sin(one.yaw / 2)]
        spec.worldbody.add_geom(type=kind, size=size, pos=[*one.place, one.sides[2] / 2], quat=turn)
    model, sensor, cameras = spec.compile(), SensorModel.realistic(), cell.make_cameras()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    rays, believed = RayCameras(model, cameras), sensor.calibrate(cameras, rng)
    cloud = gather(remove_flying(sensor.measure(rays.render(data), cameras, rng)), believed)
    return cloud.points - cell.base, rays.segment(data).ravel()[cloud.pixel]


def run(argv: list[str]) -> tuple[int, str]:
    """Run a command; return its exit code, and what it says."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = dexgrasp(argv)
    return code, said.getvalue().strip()


def target_options(way: str, thing: Thing, labels: Array, folder: Path) -> list[str]:
    """Return the options that point at a thing."""
    base, corners = default_cell().base, thing.corners()
    if way == "--mask":
        np.save(folder / "mask.npy", labels == 1)
        return [way, str(folder / "mask.npy")]
    places = [*thing.place, 0.5 * thing.sides[2]] - base
    if way == "--box":
        places = np.concatenate([corners.min(0) - base - 0.004, corners.max(0) - base + 0.004])
    return [way, *(f"{value:.4f}" for value in places)]


def tried(name: str, things: list[Thing], way: str, rng: Generator, folder: Path) -> dict[str, Any]:
    """Plan for the first of the things, export, check, and look how near the rows come to the others."""
    folder.mkdir(parents=True, exist_ok=True)
    points, labels = seen(things, rng)
    np.save(folder / "cloud.npy", points)
    grasp, rows = str(folder / "grasp.json"), folder / "rows"
    options = target_options(way, things[0], labels, folder)
    code, said = run(["plan", "--cloud", str(folder / "cloud.npy"), *options, "--out", str(folder)])
    row = {"scene": name, "way": way, "plan": code, "doubtful": "doubt:" in said}
    if code:
        return row | {"came": "refused by plan", "said": said.splitlines()[-1] if said else ""}
    code, said = run(["export", grasp, "--out", str(rows)])
    if code:
        return row | {"came": "refused by export", "said": said.splitlines()[-1]}
    code, said = run(["check", str(rows)])
    gap = clearance(rows, things)
    came = "clear" if gap > HIT else "hit"
    return row | {"check": code, "clearance": gap, "came": came if code == 0 else f"{came}, refused by check"}


def clearance(rows: Path, things: list[Thing]) -> float:
    """Return how near, m, robot and carried object come to all things but the first."""
    cell = default_cell()
    recording = read_trajectory(rows, cell)
    scene = Scene(cell, [things[0].corners()], (), [one.corners() for one in things[1:]])
    times = np.arange(0.0, recording.arm.times[-1], 0.02)
    parts = (recording.arm, recording.hand)
    path = np.stack([np.interp(times, p.times, q) for p in parts for q in p.positions.T], axis=1)
    start = recording.facts.segments["lift"].start
    robot = min(scene.clearances(q, tips_touch=False)["hand_neighbour"] for q in path)
    scene.place(path[times < start][-1])
    return float(min(robot, scene.carried(path[times >= start])[1]))


class Crowded(Script):
    """Tries all scenes; says how many are clear."""

    out: Argument[Folder]
    seed: Natural = 0
    count: Natural = 40

    def run(self) -> int:
        scenes = users()
        scenes |= {f"drawn {k}": drawn(np.random.default_rng([self.seed, k])) for k in range(self.count)}
        found = []
        self.out.mkdir(parents=True, exist_ok=True)
        with (self.out / "rows.jsonl").open("w") as file:
            for k, (name, things) in enumerate(tqdm(scenes.items(), disable=None)):
                rng = np.random.default_rng([self.seed, k, 1])
                found.append(tried(name, things, WAYS[k % len(WAYS)], rng, self.out / name.replace(" ", "_")))
                print(json.dumps(found[-1]), file=file, flush=True)
        for name, count in sorted(Counter(row["came"] for row in found).items()):
            print(f"{name}: {count} of {len(found)}")
        return int(any(row["came"] == "hit" for row in found))


if __name__ == "__main__":
    sys.exit(run_script(Crowded))
