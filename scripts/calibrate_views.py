"""Calibrate the stated probability of grasps on sides that no camera saw, or judge all that was stated, by trials.

    python scripts/object_sets.py outside sets/outside
    dexgrasp evaluate --agents bilevel --objects sets/outside/develop.json --protocol outside_one_view --out VIEWS
    python scripts/calibrate_views.py VIEWS
    python scripts/calibrate_views.py docs/results/2026-12/outside-*0 --judge

Fits the line of log odds `guessed` of the model that foretold these trials, and writes its file anew. With --judge it
writes nothing, and prints by protocol, and by whether contacts lie on a hidden side, what was said and what held: first
grasps, and whole trials; a first grasp is lost where a second was needed. Of those said 0.95 or more the lower end of
the interval has to be 0.92, else the exit code is 1.
"""

import gzip
import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.optimize import minimize
from scipy.special import logit

from dexgrasp.cli.codes import ANSWER_IS_NO, OK
from dexgrasp.cli.command import Argument, File, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.cli.figures import record_table
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.evaluation.store import read_rows
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_atomically

SURE, LEAST = 0.95, 0.92


class CalibrateViews(Script):
    """Fits and writes, or judges; 1 where what was said is not shown to hold, 2 for bad input.

    Attributes:
        runs: evaluations of `bilevel`, own or published; to calibrate, with one camera.
        model: its file.
        judge: judge what was said, and leave the model.
    """

    runs: Argument[Annotated[tuple[Folder, ...], "RUN"]]
    model: File = Path("assets/weights/probability.json")
    judge: bool = False

    def run(self) -> int:
        foretold = [row for run in self.runs for row in foretold_rows(run)]
        if self.judge:
            cells = judged(foretold)
            print(record_table(cells) if cells else "no grasp was foretold")
            return OK if all(cell["shown"] for cell in cells) else ANSWER_IS_NO
        hidden = [row for row in foretold if said_of(row)["guessed"]]
        if not hidden:
            raise InputError("no trial in which a grasp was foretold on a side that no camera saw")
        held = np.array([first_held(row) for row in hidden])
        odds = logit([said_of(row)["lifted"]["value"] for row in hidden])
        sign = np.where(held, -1.0, 1.0)
        line = minimize(lambda x: np.logaddexp(0.0, sign * (x[0] + x[1] * odds)).sum(), [0.0, 1.0]).x
        model = json.loads(self.model.read_text())
        model["guessed"] = [round(float(number), 4) for number in line]
        model["card"]["guessed"] = {"trials": len(held), "failed": int((~held).sum())}
        write_atomically(self.model, json.dumps(model, separators=(",", ":")).encode())
        print(f"wrote {self.model}: line {model['guessed']} by {len(held)} trials, {int((~held).sum())} lost")
        return OK


def foretold_rows(run: Path) -> list[Fields]:
    """Return the trials of a run, or of a published one, whose grasp was foretold."""
    published = run / "trials.jsonl.gz"
    rows = (
        list(map(json.loads, gzip.decompress(published.read_bytes()).splitlines()))
        if published.is_file()
        else read_rows(run)
    )
    return [row for row in rows if row["agent"] == "bilevel" and row["details"].get("holds_probability")]


def said_of(row: Fields) -> Fields:
    """Return what was said of a trial's grasp."""
    return dict(row["details"]["holds_probability"])


def first_held(row: Fields) -> bool:
    """Return whether a trial's first grasp held."""
    return bool(row["success"] and not row["details"].get("regrasps"))


def judged(rows: list[Fields]) -> list[Fields]:
    """Return for each cell how many trials it has, what was said in the mean, and what held."""
    cells = defaultdict[tuple[str, str], list[Fields]](list)
    for row in rows:
        cells[row["protocol"], "hidden" if said_of(row)["guessed"] else "seen"].append(row)
    found = []
    for (protocol, side), own in cells.items():
        said = np.array([said_of(row)["lifted"]["value"] for row in own])
        sure = [row for row, value in zip(own, said, strict=True) if value >= SURE]
        k, n = sum(map(first_held, sure)), len(sure)
        low = wilson_interval(k, n)[0] if n else 1.0
        found.append(
            {
                "protocol": protocol, "side": side, "trials": len(own), "said": round(float(said.mean()), 3),
                "held": round(sum(map(first_held, own)) / len(own), 3), f"said {SURE}": n, "first held": k,
                "whole held": sum(bool(row["success"]) for row in sure), "low": round(low, 3), "shown": low >= LEAST,
            }
        )  # fmt: skip
    return found


if __name__ == "__main__":
    sys.exit(run_script(CalibrateViews))
