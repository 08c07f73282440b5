"""Damaged and odd clouds through `plan_cloud`: each ends in a grasp or in a reason, never in a traceback.

    python scripts/fuzz_clouds.py --count 1000 --seed 0 [--plan 1] [--log out/clouds.jsonl]

Scenes are a table with one or two boxes, cylinders or shells on it; each gets up to three damages: noise, holes, flying
pixels, one side only, wrong unit, turned or shifted frames, NaN, repeated points, few points, a second object. `--plan`
is the share that is planned as well as segmented (planning takes a part of a second). Goes on where it stopped.
"""

import argparse
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parent))
from json_log import JsonLog

from dexgrasp import plan_cloud
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.recorded import find_object
from dexgrasp_env.perception.scan import cloud_of
from dexgrasp_env.robot.cell import default_cell

Points = NDArray[np.float64]
Damage = Callable[[Points, Generator], Points]


def table(rng: Generator) -> Points:
    """Points of the table, (N, 3) m."""
    xy = rng.uniform([0.25, -0.45], [0.80, 0.45], (rng.integers(500, 8000), 2))
    return np.column_stack([xy, rng.normal(0.0, 0.001, len(xy))])


def thing(rng: Generator) -> Points:
    """Points of a box, a cylinder or a dome on the table, (N, 3) m."""
    unit = rng.uniform(-1.0, 1.0, (rng.integers(30, 4000), 3))
    kind = rng.integers(3)
    if kind == 0:
        axis = rng.integers(0, 3, len(unit))
        unit[np.arange(len(unit)), axis] = np.sign(unit[np.arange(len(unit)), axis])
    else:
        unit[:, : 2 + (kind == 2)] /= np.linalg.norm(unit[:, : 2 + (kind == 2)], axis=1, keepdims=True) + 1e-9
    half = rng.uniform(0.015, 0.08, 3)
    place = [rng.uniform(0.35, 0.70), rng.uniform(-0.3, 0.3), half[2]]
    return unit * half + place


def _half(points: Points, rng: Generator) -> Points:
    direction = rng.normal(size=3)
    return points[(points - points.mean(0)) @ direction > 0.0]


def _turned(points: Points, rng: Generator) -> Points:
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    angle = rng.uniform(0.0, np.pi)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return points @ (np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K).T


def _holed(points: Points, rng: Generator) -> Points:
    return points[np.linalg.norm(points - points[rng.integers(len(points))], axis=1) > rng.uniform(0.01, 0.1)]


def _nan(points: Points, rng: Generator) -> Points:
    damaged = points.copy()
    damaged[rng.random(len(points)) < rng.uniform(0.0, 1.0)] = rng.choice([np.nan, np.inf, -np.inf, 1e300])
    return damaged


DAMAGES: dict[str, Damage] = {
    "noise": lambda p, rng: p + rng.normal(0.0, rng.uniform(0.0, 0.01), p.shape),
    "flying": lambda p, rng: np.concatenate([p, rng.uniform(-0.2, 0.9, (rng.integers(1, 500), 3))]),
    "half": _half,
    "hole": _holed,
    "nan": _nan,
    "turned": _turned,
    "shifted": lambda p, rng: p + rng.normal(0.0, 0.2, 3),
    "millimetres": lambda p, rng: 1000.0 * p,
    "upside down": lambda p, rng: p * np.array([1.0, 1.0, -1.0]),
    "few": lambda p, rng: p[rng.integers(0, max(len(p), 1), rng.integers(0, 60))],
    "repeated": lambda p, rng: np.repeat(p[: max(1, len(p) // 50)], 50, axis=0),
    "flat": lambda p, rng: p * np.array([1.0, 1.0, 0.0]),
    "line": lambda p, rng: p * np.array([1.0, 0.0, 0.0]),
    "second": lambda p, rng: np.concatenate([p, thing(rng)]),
    "no table": lambda p, rng: p[p[:, 2] > 0.004],
    "nothing": lambda p, rng: p[:0],
    "dense": lambda p, rng: np.concatenate([p + rng.normal(0.0, 5e-4, p.shape) for _ in range(8)]),
}


def odd_cloud(rng: Generator) -> tuple[list[str], Points]:
    """Draw a scene with its damages, by their names."""
    points = np.concatenate([table(rng), thing(rng)])
    names = [str(name) for name in rng.choice(list(DAMAGES), rng.integers(0, 4), replace=False)]
    for name in names:
        if len(points):
            points = DAMAGES[name](points, rng)
    return names, points


def outcome(points: Points, seed: int, plan: bool) -> str:
    """Return the reason, `grasp`, `object`, or `refused` for what is no cloud."""
    try:
        if plan:
            return plan_cloud(points, seed=seed).reason or "grasp"
        return find_object(cloud_of(points), np.random.default_rng(seed), default_cell()).reason or "object"
    except InputError as error:
        return "refused" if "\n" not in str(error) else "REFUSED IN MORE THAN ONE LINE"


def one(k: int, seed: int, share: float) -> dict[str, object]:
    """Return what was done to cloud `k` and what came of it."""
    rng = np.random.default_rng([seed, k])
    names, points = odd_cloud(rng)
    began, plan = time.process_time(), bool(rng.random() < share)
    try:
        found = outcome(points, k, plan)
    except Exception:
        found = "TRACEBACK"
        print(f"cloud {k} ({', '.join(names)}):", file=sys.stderr)
        traceback.print_exc()
    return {"damages": names, "plan": plan, "outcome": found, "cpu_seconds": time.process_time() - began}


def main() -> int:
    """Run; exit 1 if anything ended in a traceback."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plan", type=float, default=0.2, help="share that is planned too (default 0.2)")
    parser.add_argument("--log", type=Path, default=Path("out/clouds.jsonl"), help="to go on from")
    args = parser.parse_args()
    with JsonLog(args.log, "cloud") as log:
        for k in tqdm(range(args.count), unit="cloud"):
            name = f"{args.seed}-{k}-{args.plan}"
            if name not in log.rows or log.rows[name]["outcome"].isupper():  # what failed is tried again
                log.add({"cloud": name, **one(k, args.seed, args.plan)})
    rows = [log.rows[f"{args.seed}-{k}-{args.plan}"] for k in range(args.count)]
    found = Counter(str(row["outcome"]) for row in rows)
    for reason, count in found.most_common():
        print(f"{count:6d}  {reason}")
    return 1 if any(reason.isupper() for reason in found) else 0


if __name__ == "__main__":
    sys.exit(main())
