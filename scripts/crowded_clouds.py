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
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.random import Generator
from table_scenes import Body, seen, written

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.cli.main import main as dexgrasp
from dexgrasp.export.read import read_trajectory
from dexgrasp.grasp.verify.scene import Scene
from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.poses import about_z
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.sensing.sensor import SensorModel
from dexgrasp_env.tasks.arrangement import gap_between
from dexgrasp_env.valid import Natural

HIT = -0.001  # m
WAYS = ("--object-near", "--box", "--mask")
CAN, BOX = (0.066, 0.066, 0.10), (0.04, 0.09, 0.17)


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
    can = thing(CAN, (0.5, 0.0), can=True)
    around = [thing((0.06, 0.06, 0.12), place) for place in ((0.6, 0), (0.4, 0), (0.5, 0.1), (0.5, -0.1))]
    five = [((0.62, 0.08), BOX), ((0.45, -0.13), CAN), ((0.6, -0.08), (0.05, 0.05, 0.05)), ((0.42, 0.1), CAN)]
    return {
        **{
            f"gap {100 * gap:g} cm": [can, thing(BOX, (0.5, 0.078 + gap))] for gap in (0.10, 0.05, 0.03, 0.02)
        },
        "four boxes around": [can, *around],
        "five objects": [can, *(thing(sides, place, 0.4, sides == CAN) for place, sides in five)],
        "bin, middle": [can, *bin_around((0.35, -0.2), (0.65, 0.2), 0.08)],
        "bin, corner": [can, *bin_around((0.45, -0.05), (0.75, 0.27), 0.08)],
    }


def drawn(rng: Generator) -> list[Body]:
    """Draw a scene: one to five things beside the first, 0.5 to 8 cm away, or a bin around all."""
    things = [_drawn(rng).moved([rng.uniform(0.45, 0.58), rng.uniform(-0.12, 0.12), 0.0])]
    for angle in rng.permutation(6)[: rng.integers(1, 6)] * np.pi / 3.0 + rng.uniform(0.0, 1.0):
        other, gap = _drawn(rng), np.exp(rng.uniform(np.log(0.005), np.log(0.08)))
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


def _drawn(rng: Generator) -> Body:
    can = bool(rng.random() < 0.4)
    a, b, c = rng.uniform((0.04, 0.04, 0.05), (0.075, 0.11, 0.18))
    return thing((a, a if can else b, c), (0.0, 0.0), rng.uniform(0.0, np.pi), can)


def run(argv: list[str]) -> tuple[int, str]:
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


def tried(name: str, things: list[Body], way: str, rng: Generator, folder: Path) -> Fields:
    """Plan for the first of the things, export, check, and look how near the rows come to the others."""
    folder.mkdir(parents=True, exist_ok=True)
    cloud, labels = seen(things, default_cell().make_cameras(), SensorModel.realistic(), rng)
    np.save(folder / "cloud.npy", cloud.points)
    rows, options = folder / "rows", target_options(way, things[0], labels, folder)
    code, said = run(["plan", "--cloud", str(folder / "cloud.npy"), *options, "--out", str(folder)])
    row = {"scene": name, "way": way, "plan": code, "doubtful": "doubt:" in said}
    if code:
        return row | {"came": "refused by plan", "said": said.splitlines()[-1] if said else ""}
    code, said = run(["export", str(folder / "grasp.json"), "--out", str(rows)])
    if code:
        return row | {"came": "refused by export", "said": said.splitlines()[-1]}
    code, said = run(["check", str(rows)])
    gap = clearance(rows, things)
    came = "clear" if gap > HIT else "hit"
    return row | {"check": code, "clearance": gap, "came": came if code == 0 else f"{came}, refused by check"}


def clearance(rows: Path, things: list[Body]) -> float:
    """Return how near, m, robot and carried object come to all things but the first."""
    cell = default_cell()
    recording = read_trajectory(rows, cell)
    scene = Scene(cell, [things[0].corners], (), [one.corners for one in things[1:]])
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
        found = written(self.out, self._rows(scenes), len(scenes))
        for name, count in sorted(Counter(row["came"] for row in found).items()):
            print(f"{name}: {count} of {len(found)}")
        return int(any(row["came"] == "hit" for row in found))

    def _rows(self, scenes: dict[str, list[Body]]) -> Iterator[Fields]:
        for k, (name, things) in enumerate(scenes.items()):
            rng = np.random.default_rng([self.seed, k, 1])
            yield tried(name, things, WAYS[k % len(WAYS)], rng, self.out / name.replace(" ", "_"))


if __name__ == "__main__":
    sys.exit(run_script(Crowded))
