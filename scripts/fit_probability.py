"""Fit how likely a grasp holds, on the episodes of `probability_data.py`, and judge it on shapes that it never met.

    pip install -c constraints.txt 'dexgrasp[fit,planner]'
    python scripts/fit_probability.py DATA --out assets/weights/probability.json

Judged by cross-validation over shapes: every row is foretold by a model that met no episode of its shape, within each
cell of friction and mass. The model that is written is fitted on all of DATA. DATA/judged.json has the figures and the
reliability diagrams.
"""

import json
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from dexgrasp.cli.command import Argument, File, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.grasp.file import record_of
from dexgrasp.grasp.probability import OUTCOMES, Model, read_model
from dexgrasp.grasp.probability_features import features_of
from dexgrasp.runs.shards import read_shard, text_of
from dexgrasp.runs.versions import package_version
from dexgrasp_env.arrays import Array
from dexgrasp_env.files import write_atomically, write_json

LABELS = {"lifted": "lift", "pushed": "pushed@1"}
RISES = ("friction", "borne", "borne_low")
FALLS = ("slips", "slips_pushed", "friction_use")
"""Features that a grasp can only be more, or less, likely to hold with."""
FRICTIONS, MASSES = (0.3, 0.45, 0.6, 0.75, 0.9), (0.5, 1.0, 1.75, 3.0)
"""Ends of the cells."""
MEMBERS, FOLDS, LEAST = 12, 5, 8  # LEAST: successes and failures that a cell must have for an area
_TREES: dict[str, Any] = {
    "max_iter": 60, "learning_rate": 0.1, "max_leaf_nodes": 6, "min_samples_leaf": 20, "l2_regularization": 5.0,
    "early_stopping": False,
}  # fmt: skip


class Rows(NamedTuple):
    """Episodes: features and outcomes by name (N,), shapes, masses over the objects' own (N,)."""

    features: dict[str, Array]
    held: dict[str, NDArray[np.bool_]]
    shapes: NDArray[np.str_]
    factor: Array

    @property
    def matrix(self) -> Array:
        """(N, F), in the order of the names."""
        return np.nan_to_num(np.stack(list(self.features.values()), 1))


def read_rows(folder: Path) -> Rows:
    """Compute the features of every episode in a folder."""
    found: list[dict[str, Any]] = []
    for path in tqdm(sorted(folder.glob("scene-*.npz")), unit="scene", disable=None):
        arrays = read_shard(path)
        scene = json.loads(text_of(arrays["row"]))
        if not scene["rows"]:
            continue
        record, guessed = record_of(scene["record"]), 0.0
        if "spread_errors" in arrays:
            nearest = (record.normals @ arrays["spread_directions"].T).argmax(1)
            guessed = float(arrays["spread_errors"][nearest].max())
        for row in scene["rows"]:
            features = features_of(record, row["friction"], row["mass_factor"] * scene["mass"], guessed)
            found.append({"features": features, "row": row, "job": scene["job"]})
    names = list(found[0]["features"])
    return Rows(
        {name: np.array([one["features"][name] for one in found]) for name in names},
        {name: np.array([one["row"][of]["success"] for one in found]) for name, of in LABELS.items()},
        np.array([one["job"]["target"].split("/")[-1] for one in found]),
        np.array([one["row"]["mass_factor"] for one in found]),
    )


class Ensemble:
    """Trees fitted on shapes drawn anew, calibrated on those that were not drawn."""

    def __init__(
        self, x: Array, held: NDArray[np.bool_], shapes: NDArray[np.str_], names: list[str], seed: int = 0
    ) -> None:
        """Fit."""
        from sklearn.ensemble import HistGradientBoostingClassifier  # the extra `fit`
        from sklearn.linear_model import LogisticRegression

        rng, kinds = np.random.default_rng(seed), np.unique(shapes)
        ways = [1 if name in RISES else -1 if name in FALLS else 0 for name in names]
        self.members, total, count = [], np.zeros(len(x)), np.zeros(len(x))
        for member in range(MEMBERS):
            drawn, times = np.unique(rng.choice(kinds, len(kinds)), return_counts=True)
            weight = dict(zip(drawn, times, strict=True))
            w = np.array([weight.get(shape, 0) for shape in shapes], float)
            trees = HistGradientBoostingClassifier(monotonic_cst=ways, random_state=member, **_TREES)
            trees.fit(x[w > 0], held[w > 0], w[w > 0])
            self.members.append(trees)
            out = w == 0
            total[out] += trees.decision_function(x[out])
            count[out] += 1
        met = count > 0
        line = LogisticRegression(C=1e3).fit((total[met] / count[met])[:, None], held[met])
        self.offset, self.slope = float(line.intercept_[0]), float(line.coef_[0, 0])

    def odds(self, x: Array) -> Array:
        """Return the calibrated log odds (M, N) of the members."""
        return np.array([self.offset + self.slope * trees.decision_function(x) for trees in self.members])

    def as_json(self) -> dict[str, Any]:
        """Return it as the model file holds it."""
        columns: dict[str, list[Any]] = {
            name: [] for name in ("feature", "threshold", "left", "right", "value", "roots", "member")
        }
        for number, trees in enumerate(self.members):
            first = float(np.ravel(trees._baseline_prediction)[0])
            for (tree,) in trees._predictors:
                start = len(columns["feature"])
                columns["roots"].append(start)
                columns["member"].append(number)
                for name, values in _nodes(tree.nodes, start, first).items():
                    columns[name] += values
                first = 0.0
        return columns | {"calibration": [self.offset, self.slope]}


def _nodes(nodes: Any, start: int, more: float) -> dict[str, list[Any]]:
    """Return a tree's nodes, numbered from `start` on; `more` is added to what its leaves say."""
    leaf = nodes["is_leaf"].astype(bool)
    return {
        "feature": np.where(leaf, 0, nodes["feature_idx"]).tolist(),
        "threshold": [float(f"{value:.7g}") for value in np.where(leaf, 0.0, nodes["num_threshold"])],
        "left": np.where(leaf, -1, start + nodes["left"].astype(int)).tolist(),
        "right": np.where(leaf, -1, start + nodes["right"].astype(int)).tolist(),
        "value": [float(f"{value:.5g}") for value in np.where(leaf, nodes["value"] + more, 0.0)],
    }


def foretold(rows: Rows, outcome: str) -> Array:
    """Return probabilities (N,) by models that met no episode of a row's shape."""
    kinds, x = np.unique(rows.shapes), rows.matrix
    fold_of = dict(zip(kinds, np.random.default_rng(1).permutation(len(kinds)) % FOLDS, strict=True))
    fold, odds = np.array([fold_of[shape] for shape in rows.shapes]), np.zeros((MEMBERS, len(x)))
    for k in range(FOLDS):
        met, own = fold != k, fold == k
        fitted = Ensemble(x[met], rows.held[outcome][met], rows.shapes[met], list(rows.features))
        odds[:, own] = fitted.odds(x[own])
    return 1.0 / (1.0 + np.exp(-odds.mean(0)))


def cells(rows: Rows) -> Iterator[NDArray[np.bool_]]:
    """Yield which rows are in each cell of friction and mass."""
    friction = rows.features["friction"]
    for low, high in pairwise(FRICTIONS):
        for least, most in pairwise(MASSES):
            # A factor of 1, the commonest, is in one cell only.
            below = rows.factor <= most if most == MASSES[-1] else rows.factor < most
            yield (friction >= low) & (friction <= high) & (rows.factor >= least) & below


def calibration(chance: Array, held: NDArray[np.bool_], bins: int) -> tuple[float, list[dict[str, Any]]]:
    """Return the expected calibration error, and what was predicted and came true in bins of equal width."""
    at = np.minimum((chance * bins).astype(int), bins - 1)
    diagram, gaps = [], 0.0
    for inside in (at == k for k in np.unique(at)):
        count, n, mean = int(held[inside].sum()), int(inside.sum()), float(chance[inside].mean())
        diagram.append({"predicted": mean, "held": count, "of": n, "ci95": wilson_interval(count, n)})
        gaps += abs(mean - count / n) * n
    return gaps / len(held), diagram


def judged(rows: Rows, outcome: str, chance: Array) -> dict[str, Any]:
    """Return how good probabilities are, over all rows and within cells of friction and mass."""
    from sklearn.metrics import roc_auc_score

    held = rows.held[outcome]
    own = [inside for inside in cells(rows) if inside.any()]
    areas = [
        roc_auc_score(held[inside], chance[inside])
        for inside in own
        if LEAST <= held[inside].sum() <= inside.sum() - LEAST
    ]
    error, diagram = calibration(chance, held, 10)
    return {
        "episodes": len(held),
        "failed": int((~held).sum()),
        "shapes": len(np.unique(rows.shapes)),
        "area_of_cells": float(np.mean(areas)) if areas else None,
        "calibration_error": error,
        "calibration_error_of_cells": float(np.mean([calibration(chance[i], held[i], 5)[0] for i in own])),
        "diagram": diagram,
    }


def write_model(path: Path, rows: Rows, robot: str, judgement: dict[str, Any]) -> Model:
    """Fit on all episodes, write the model, and return it as it is read again."""
    names = list(rows.features)
    content = {
        "schema": 1,
        "robot": robot,
        "features": names,
        "guessed": [0.0, 1.0],
        "outcomes": {
            name: Ensemble(rows.matrix, rows.held[name], rows.shapes, names).as_json() for name in OUTCOMES
        },
        "card": judgement,
    }
    write_atomically(path, json.dumps(content, separators=(",", ":")).encode())
    return read_model(path)


class Fit(Script):
    """Judges, fits, writes."""

    data: Argument[Folder]
    out: File | None = None

    def run(self) -> int:
        rows = read_rows(self.data)
        found = {name: judged(rows, name, foretold(rows, name)) for name in OUTCOMES}
        if self.out:
            model = write_model(self.out, rows, self._robot(), _card(found))
            print(f"wrote {self.out}, {self.out.stat().st_size / 1e3:.0f} kB, {model.hash}")
        write_json(self.data / "judged.json", found)
        print(json.dumps({name: one | {"diagram": None} for name, one in found.items()}, indent=1))
        return 0

    def _robot(self) -> str:
        scene = json.loads(text_of(read_shard(min(self.data.glob("scene-*.npz")))["row"]))
        return str(scene["record"]["robot"]["hash"])


def _card(found: dict[str, Any]) -> dict[str, Any]:
    kept = ("episodes", "failed", "shapes", "area_of_cells", "calibration_error")
    return {
        "data": "scripts/probability_data.py",
        "scikit-learn": package_version("scikit-learn"),
        **{name: {key: one[key] for key in kept} for name, one in found.items()},
    }


if __name__ == "__main__":
    sys.exit(run_script(Fit))
