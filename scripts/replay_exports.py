"""Exports every grasp of an evaluation, checks it, and replays it open loop with the object off, beside closed loop.

    dexgrasp evaluate --agents bilevel --objects all20 --trials 10 --out runs/lift
    python scripts/replay_exports.py runs/lift --out runs/replays.jsonl

Each grasp is written as `export --format mjcf` does, read back by `check`, and played once in MuJoCo with the object
3 mm off in a random direction and turned by 1 degree; its trial of the evaluation is the closed loop. With `--bullet`
it is played in Bullet as well, the object off by the same. Goes on where it stopped.
"""

import argparse
import sys
import tempfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parent))
from json_log import JsonLog

from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.evaluation.store import read_rows
from dexgrasp.export.check import check_trajectory
from dexgrasp.export.grasp_export import export_grasp
from dexgrasp.export.read import read_trajectory
from dexgrasp.export.replay import replay
from dexgrasp.grasp.file import read_grasp
from dexgrasp_env.errors import InputError


def _rng(seed: int, row: dict[str, Any]) -> np.random.Generator:
    """What the object's error is drawn from, another one for each object and trial."""
    return np.random.default_rng([seed, row["trial"], zlib.crc32(row["object"].encode())])


def one(run: Path, row: dict[str, Any], seed: int, bullet: bool = False) -> dict[str, Any]:
    """Return what became of the grasp of one trial."""
    found = {"grasp": row["grasp"], "object": row["object"], "closed": row["success"]}
    record = read_grasp(run / row["grasp"])
    with tempfile.TemporaryDirectory() as folder:
        try:
            export_grasp(record, Path(folder), "mjcf")
        except InputError as error:
            return found | {"error": str(error), "failed": [], "open": False}
        recording = read_trajectory(Path(folder))
        findings = check_trajectory(recording)
        played = replay(recording, Path(folder) / "scene.xml", _rng(seed, row))
        if bullet:
            from replay_bullet import replay_in_bullet

            second = replay_in_bullet(recording, Path(folder) / "scene.xml", _rng(seed, row))
            found |= {"bullet": second.success, "bullet_height": second.height}
    shares = {f.name: f.value for f in findings if "share" in f.name}
    failed = [f.name for f in findings if not f.holds]
    return found | {"failed": failed, "open": played.success, "height": played.height, "shares": shares}


def summary(rows: list[dict[str, Any]]) -> str:
    """Return the counts with Wilson's intervals."""
    lines = []
    counts = [
        ("within all limits and free", [not row["failed"] and "error" not in row for row in rows]),
        ("held, open loop, 3 mm and 1 deg off", [row["open"] for row in rows]),
        ("held, closed loop", [row["closed"] for row in rows]),
    ]
    if any("bullet" in row for row in rows):
        both = [row.get("bullet", False) for row in rows if "bullet" in row or "error" in row]
        counts.append(("held, open loop, the same in Bullet", both))
    for name, good in counts:
        low, high = wilson_interval(sum(good), len(good))
        lines.append(f"{name:<38} {sum(good)}/{len(good)} = {np.mean(good):.1%} [{low:.1%}, {high:.1%}]")
    worst: dict[str, float] = {}
    for row in rows:
        for name, share in row.get("shares", {}).items():
            worst[name] = max(worst.get(name, 0.0), share)
    lines += [f"most of all: {name:<40} {share:.3f}" for name, share in worst.items()]
    return "\n".join(lines)


def main() -> int:
    """Run; 1 if any export is outside its limits."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, help="the --out of `dexgrasp evaluate`")
    parser.add_argument("--out", type=Path, required=True, help="a line of JSON for each grasp")
    parser.add_argument("--agent", default="bilevel")
    parser.add_argument("--seed", type=int, default=0, help="of the object's errors")
    parser.add_argument(
        "--trials", type=int, metavar="N", help="the first N of each object alone (default all)"
    )
    parser.add_argument("--bullet", action="store_true", help="in Bullet as well (pip install pybullet)")
    args = parser.parse_args()
    own = [row for row in read_rows(args.run) if row["agent"] == args.agent and row.get("grasp")]
    trials = [row for row in own if args.trials is None or row["trial"] < args.trials]
    with JsonLog(args.out, "grasp") as log, tqdm(total=len(trials), unit="export") as bar:
        for trial in trials:
            if trial["grasp"] not in log.rows:
                log.add(one(args.run, trial, args.seed, args.bullet))
            bar.update()
    rows = list(log.rows.values())
    print(summary(rows))
    return int(any(row["failed"] or "error" in row for row in rows))


if __name__ == "__main__":
    sys.exit(main())
