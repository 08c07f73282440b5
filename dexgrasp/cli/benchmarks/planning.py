"""Benchmark of planning: seconds from a perceived cloud to a grasp that `verify` confirms, by stage.

The paper took 14.4 s in the median (Table 6). Its ratio to ours compares two machines; the ratio of stages, and the
share of verified grasps, do not.
"""

import time
from collections import Counter
from collections.abc import Sequence
from itertools import product

import numpy as np
from tqdm import tqdm

from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.evaluation.statistics import quantiles, wilson_interval
from dexgrasp.grasp.file import record_of
from dexgrasp.grasp.verify.verify import verify
from dexgrasp.planning.scene_setup import look_at
from dexgrasp_env.arrays import Fields
from dexgrasp_env.objects.catalogue import OBJECT_SETS


def run(quick: bool = False) -> Fields:
    """Plan for the 20 test objects in five poses each, with the default sensor noise, on one core.

    Args:
        quick: five objects, two poses.
    """
    names, poses = (OBJECT_SETS["all20"][::4], 2) if quick else (OBJECT_SETS["all20"], 5)
    agent, scenes = BilevelAgent(), list(product(names, range(poses)))
    return _figures([_one(agent, *scene) for scene in tqdm(scenes, desc="planning", unit="grasp")])


def _one(agent: BilevelAgent, name: str, seed: int) -> Fields:
    look = look_at(name, agent, seed)
    cpu = time.process_time()
    agent.reset(look.observation, {"perception_failure": look.info["perception_failure"]})
    cpu = time.process_time() - cpu
    look.env.close()
    report, plan = agent.report, agent.result
    row: Fields = {
        "object": name, "seconds": report.planning_seconds, "cpu": cpu, "failure": report.failure,
        "stages": report.details.get("stages", {}),
    }  # fmt: skip
    if plan is not None and plan.grasp is not None:
        checks = verify(record_of(plan.contents(name)[0]))
        row["broken"] = [check.name for check in checks if not check.holds]
    return row


def _figures(rows: list[Fields]) -> Fields:
    found = [row for row in rows if row["failure"] is None]
    good = [row for row in found if not row["broken"] and row["seconds"] <= 2.0]  # s
    seconds = [row["seconds"] for row in rows]
    stages = sorted({stage for row in found for stage in row["stages"]})
    return {
        "plans": len(rows),
        "verified within 2 s": {"share": len(good) / len(rows), "ci95": wilson_interval(len(good), len(rows))},
        "returned grasps that pass verify": {
            "share": (sum(not row["broken"] for row in found) / len(found)) if found else 0.0, "of": len(found),
        },
        "broken": dict(Counter(name for row in found for name in row["broken"])),
        "failures": dict(Counter(row["failure"] for row in rows if row["failure"])),
        "seconds": _distribution(seconds),
        "cpu seconds": _distribution([row["cpu"] for row in rows]),
        "stages, median ms": {
            s: 1000.0 * np.median([row["stages"].get(s, 0.0) for row in found]) for s in stages
        },
        "paper's median over ours": 14.40 / np.median(seconds),
    }  # fmt: skip


def _distribution(values: Sequence[float]) -> Fields:
    """Return the median with its 95 % bootstrap interval, the 90th percentile and the maximum."""
    drawn = np.random.default_rng(0).choice(np.asarray(values, dtype=float), (2000, len(values)))
    interval = np.quantile(np.median(drawn, axis=1), [0.025, 0.975])
    return {**quantiles(values, median=0.5, p90=0.9, max=1.0), "ci95": interval}
