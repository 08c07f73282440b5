"""Certificates as predictions: do grasps with more to spare succeed more often?"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import rankdata

from dexgrasp_env.arrays import Array, Fields, Mask

PREDICTORS = {
    "load": "load, in weights",
    "capacity": "capacity, in weights",
    "closure_margin": "closure margin",
    "lifted": "probability to be lifted and held",
    "pushed": "probability to be held through pushes",
}
"""Fields of a certificate, or probabilities, of which more should be better -> what reports call them."""
_BINS = 5
_LEAST = 10
"""Trials in a bin at least."""
_RESAMPLES = 2000


class Bin(NamedTuple):
    """Trials with alike values of a predictor: their median, and how they went."""

    median: float
    successes: int
    trials: int


class Prediction(NamedTuple):
    """Return how well a field of the certificate orders the outcomes.

    Attributes:
        trials: with a certificate.
        auc: the chance that, of a success and a failure, the success has the larger value; 0.5: it says nothing.
        interval: of it, 95 %, from trials drawn anew.
        bins: trials in equal parts by the value, from the least on.
    """

    trials: int
    auc: float
    interval: tuple[float, float]
    bins: tuple[Bin, ...]


def predictions(rows: Sequence[Fields]) -> dict[str, Prediction]:
    """Return what each predictor says of trials with certificates; {} where all went well, or all failed."""
    found = {}
    for name in PREDICTORS:
        known = [(value, bool(row["success"])) for row in rows if (value := _field(row, name)) is not None]
        if len({success for _, success in known}) == 2:
            values, successes = (np.array(column) for column in zip(*known, strict=True))
            found[name] = Prediction(
                len(known), auc(values, successes), _interval(values, successes), _bins(values, successes)
            )
    return found


def _field(row: Fields, name: str) -> float | None:
    chances = row["details"].get("holds_probability") or {}
    value = chances[name]["value"] if name in chances else (row["details"].get("certificate") or {}).get(name)
    return float(value) if isinstance(value, int | float) and np.isfinite(value) else None


def auc(values: Array, successes: Mask) -> float:
    """Return the area under the ROC curve: the Mann-Whitney statistic, ties counted half; 0.5 for one class."""
    wins = int(successes.sum())
    losses = len(successes) - wins
    if not wins or not losses:
        return 0.5
    return float((rankdata(values)[successes].sum() - 0.5 * wins * (wins + 1)) / (wins * losses))


def _interval(values: Array, successes: Mask) -> tuple[float, float]:
    draws = np.random.default_rng(0).integers(len(values), size=(_RESAMPLES, len(values)))
    low, high = np.quantile([auc(values[at], successes[at]) for at in draws], [0.025, 0.975])
    return float(low), float(high)


def _bins(values: Array, successes: Mask) -> tuple[Bin, ...]:
    parts = np.array_split(np.argsort(values, kind="stable"), max(1, min(_BINS, len(values) // _LEAST)))
    return tuple(Bin(float(np.median(values[at])), int(successes[at].sum()), len(at)) for at in parts)
