"""Calibrate the stated probability of grasps on sides that no camera saw, on the trials of an evaluation.

    python scripts/object_sets.py outside sets/outside
    dexgrasp evaluate --agents bilevel --objects sets/outside/develop.json --protocol outside_one_view --out VIEWS
    python scripts/calibrate_views.py VIEWS

Fits the line of log odds `guessed` of the model that foretold these trials, and writes its file anew. With --judge it
writes nothing, and prints what the model as it is says of these trials. A trial with a regrasp counts as lost.
"""

import json
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit

from dexgrasp.cli.command import Argument, File, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.evaluation.store import read_rows
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_atomically


class CalibrateViews(Script):
    """Fits and writes, or judges; 2 for bad input.

    Attributes:
        views: an evaluation of `bilevel` with one camera.
        model: its file.
        judge: judge the model on these trials, and leave it.
    """

    views: Argument[Folder]
    model: File = Path("assets/weights/probability.json")
    judge: bool = False

    def run(self) -> int:
        model, known = json.loads(self.model.read_text()), list[tuple[float, bool]]()
        for row in read_rows(self.views):
            stated = row["details"].get("holds_probability") or {}
            if stated.get("guessed"):
                first = row["success"] and not row["details"].get("regrasps")
                known.append((stated["lifted"]["value"], first))
        if not known:
            raise InputError(
                f"{self.views} has no trial in which a grasp was foretold on a side that no camera saw"
            )
        said, held = map(np.array, zip(*known, strict=True))
        odds, lost = logit(said), int((~held).sum())
        if self.judge:
            offset, slope = model["guessed"]
            said = expit(offset + slope * odds)
            for least in (0.0, 0.8, 0.9, 0.95):
                sure = said >= least
                k, n = int(held[sure].sum()), int(sure.sum())
                print(f"said >= {least}: {k} of {n} held, {wilson_interval(k, n) if n else '-'}")
            return 0
        sign = np.where(held, -1.0, 1.0)
        line = minimize(lambda x: np.logaddexp(0.0, sign * (x[0] + x[1] * odds)).sum(), [0.0, 1.0]).x
        model["guessed"] = [round(float(number), 4) for number in line]
        model["card"]["guessed"] = {"trials": len(held), "failed": lost}
        write_atomically(self.model, json.dumps(model, separators=(",", ":")).encode())
        print(f"wrote {self.model}: line {model['guessed']} by {len(held)} trials, {lost} of them lost")
        return 0


if __name__ == "__main__":
    sys.exit(run_script(CalibrateViews))
