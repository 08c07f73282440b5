"""Does it help to take the likeliest of many grasps where the first one is unsure? In pairs, under `pushed@1`.

    python scripts/rank_by_probability.py runs/rank.jsonl --scenes 400

Scene k is of `varied-30000+k`, which the fit never met: friction 0.35, 0.45 or 0.7, which the planner is told; four
cameras or one. Where the first grasp is held through pushes with less than `LEAST`, it and the likeliest of `COUNT`
that differ are carried out alike. FILE has a line a scene; those that are there are not made again.
"""

import json
import sys
from typing import Any

import numpy as np
from probability_data import Job, look, outcome_of

from dexgrasp.cli.command import Argument, File, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.statistics import mcnemar
from dexgrasp.planning.diverse import chances_of, plan_many
from dexgrasp.planning.plan_scene import plan_scene
from dexgrasp.planning.result import Planned, PlanResult
from dexgrasp.runs.progress import progress_bar
from dexgrasp_env.valid import Count

SEED = 5100
LEAST, COUNT = 0.9, 24
FRICTIONS, SEEN = (0.35, 0.45, 0.7), ("cameras", "one_view")


def job_of(number: int) -> Job:
    """Return scene `number`."""
    rng = np.random.default_rng([SEED, number])
    friction, seed = float(rng.choice(FRICTIONS)), int(rng.integers(2**31))
    seen = str(rng.choice(SEEN))
    return Job(number, f"varied-{30000 + number}", seed, seen, "bilevel", friction, False, ((friction, 1.0),))


def row_of(job: Job) -> dict[str, Any]:
    """Return how the first grasp and the likeliest one held, where they differ and the first is unsure."""
    planner, scene, start, _ = look(job)
    first = plan_scene(planner, scene, job.seed, start)
    row: dict[str, Any] = {"scene": job.number, "friction": job.told_friction, "seen": job.seen}
    if not first.found:
        return row
    row["first"] = chance(first.found[0], first)
    if row["first"] < LEAST and first.target is not None:
        others = plan_many(planner, first.target, COUNT, job.seed, start).found
        if others:
            best = max(others, key=lambda one: chance(one, first))
            row["best"] = chance(best, first)
            for name, planned in (("first_held", first.found[0]), ("best_held", best)):
                row[name] = outcome_of(job, planned, job.conditions[0])["pushed@1"]["success"]
    return row


def chance(planned: Planned, result: PlanResult) -> float:
    """Return how likely a grasp is held through pushes."""
    return chances_of(planned, result).pushed.value


class Rank(Script):
    """Plays the scenes that are not there yet, and counts."""

    out: Argument[File]
    scenes: Count = 400

    def run(self) -> int:
        """Play and count."""
        lines = self.out.read_text().splitlines() if self.out.exists() else []
        rows = [json.loads(line) for line in lines]
        with progress_bar("scene", "scenes") as show, self.out.open("a") as file:
            for number in range(len(rows), self.scenes):
                rows.append(row_of(job_of(number)))
                file.write(json.dumps(rows[-1]) + "\n")
                file.flush()
                show(number + 1, self.scenes)
        for more in (0.0, 0.1):
            held = [
                (r["first_held"], r["best_held"])
                for r in rows
                if r.get("best", 0.0) - r.get("first", 0.0) > more
            ]
            told = mcnemar(held)
            print(f"likelier by more than {more}: {len(held)} scenes, first and likeliest held: {told}")
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Rank))
