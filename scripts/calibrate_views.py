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

import json
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.optimize import minimize
from scipy.special import logit
from season_pages import TRIALS, unpack

from dexgrasp.cli.command import Argument, File, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.cli.output import record_table
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.evaluation.store import read_rows
from dexgrasp.evaluation.summary import grouped
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_atomically

SURE, LEAST = 0.95, 0.92


class CalibrateViews(Script):
    """Fit the model and write it, or judge it; exit code 1 where a stated probability is not shown to hold.

    Attributes:
        runs: evaluations of `bilevel`, own or published; to calibrate, with one camera.
        model: its file.
        judge: judge what was said, and leave the model.
    """

    runs: Argument[Annotated[tuple[Folder, ...], "RUN"]]
    model: File = Path("assets/weights/probability.json")
    judge: bool = False

    def run(self) -> int:
        rows = [row for run in self.runs for row in foretold(run)]
        if self.judge:
            cells = judged(rows)
            print(record_table(cells) if cells else "no grasp was foretold")
            return int(any(not cell["shown"] for cell in cells))
        hidden = [row for row in rows if row["cell"][1] == "hidden"]
        if not hidden:
            raise InputError("no trial in which a grasp was foretold on a side that no camera saw")
        odds, held = logit([row["said"] for row in hidden]), np.array([row["first"] for row in hidden])
        sign, lost = np.where(held, -1.0, 1.0), int((~held).sum())
        line = minimize(lambda x: np.logaddexp(0.0, sign * (x[0] + x[1] * odds)).sum(), [0.0, 1.0]).x
        model = json.loads(self.model.read_text())
        model["guessed"] = [round(float(number), 4) for number in line]
        model["card"]["guessed"] = {"trials": len(held), "failed": lost}
        write_atomically(self.model, json.dumps(model, separators=(",", ":")).encode())
        print(f"wrote {self.model}: line {model['guessed']} by {len(held)} trials, {lost} lost")
        return 0


def foretold(run: Path) -> list[Fields]:
    """Return of a run, or of a published one, each trial whose grasp was foretold: what was said, and what held."""
    found = []
    with tempfile.TemporaryDirectory() as place:
        rows = read_rows(unpack(run, Path(place)) if (run / f"{TRIALS}.gz").is_file() else run)
    for row in rows:
        stated = row["details"].get("holds_probability")
        if row["agent"] == "bilevel" and stated:
            first = row["success"] and not row["details"].get("regrasps")
            cell = row["protocol"], "hidden" if stated["guessed"] else "seen"
            said = stated["lifted"]["value"]
            found.append({"cell": cell, "said": said, "first": first, "whole": row["success"]})
    return found


def judged(rows: list[Fields]) -> list[Fields]:
    """Return for each cell how many trials it has, what was said in the mean, and what held."""
    found = []
    for (protocol, side), own in grouped(rows, "cell").items():
        said, first, whole = (np.array([row[key] for row in own]) for key in ("said", "first", "whole"))
        sure = said >= SURE
        k, n = int(first[sure].sum()), int(sure.sum())
        low = wilson_interval(k, n)[0] if n else 1.0
        found.append(
            {
                "protocol": protocol, "side": side, "trials": len(own), "said": round(float(said.mean()), 3),
                "held": round(float(first.mean()), 3), f"said {SURE}": n, "first held": k,
                "whole held": int(whole[sure].sum()), "low": round(low, 3), "shown": low >= LEAST,
            }
        )  # fmt: skip
    return found


if __name__ == "__main__":
    sys.exit(run_script(CalibrateViews))
