"""The probability that a grasp holds, by a model that was fitted on episodes (`assets/weights/README.md`).

The model is an ensemble of boosted trees on the figures of `probability_features`, each member fitted on shapes drawn
anew, so that how far they disagree says how much hangs on which shapes were met. Their mean is calibrated on shapes
that a member had not met, and once more on single views for grasps whose contacts no camera saw
(`scripts/calibrate_views.py`). It knows one robot. Of grasps of another, among neighbours, made for surfaces more
slippery than 0.7 or under a request's constraints it says nothing: no trials have tested what it says there.
"""

import json
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dexgrasp.grasp.probability_features import features_of
from dexgrasp.grasp.record import Chance, GraspRecord, HoldsProbability
from dexgrasp.grasp.thresholds import HOLD_SHARE
from dexgrasp_env.arrays import Array, Fields, Index
from dexgrasp_env.assets import asset_path
from dexgrasp_env.files import content_hash, read_file
from dexgrasp_env.scene.constants import FRICTION

OUTCOMES = ("lifted", "pushed")
"""Outcomes with a probability: held for 3 s (`lift`), and through pushes by the weight from six sides (`pushed@1`)."""
LEAST_FRICTION = 0.5
"""True friction down to which probabilities of grasps that count on more were tested."""


class Trees(NamedTuple):
    """Regression trees of all members: nodes (K,), a leaf's `left` being -1; root and member of each tree (T,)."""

    feature: Index
    threshold: Array
    left: Index
    right: Index
    value: Array
    roots: Index
    member: Index

    def log_odds(self, x: Array) -> Array:
        """Return the sum (M,) of each member's trees for features (F,)."""
        node = self.roots
        while (self.left[node] >= 0).any():
            below = np.where(x[self.feature[node]] <= self.threshold[node], self.left[node], self.right[node])
            node = np.where(self.left[node] >= 0, below, node)
        return np.asarray(np.bincount(self.member, self.value[node]), dtype=float)


class Model(NamedTuple):
    """Ensemble of boosted trees with its calibration.

    Attributes:
        hash: of its file.
        robot: hash of the robot that it was fitted with.
        features: names, in the order of the trees.
        outcomes: trees of each, and the line that calibrates the log odds: offset and slope.
        guessed: the line that calibrates those of lifting once more where contacts are on a side that no camera saw.
    """

    hash: str
    robot: str
    features: tuple[str, ...]
    outcomes: dict[str, tuple[Trees, tuple[float, float]]]
    guessed: tuple[float, float]

    def chances(self, features: dict[str, float]) -> dict[str, Chance]:
        """Return the probability of each outcome for features by name."""
        x = np.nan_to_num(np.array([features[name] for name in self.features]))
        found = {}
        for name, (trees, (offset, slope)) in self.outcomes.items():
            odds = offset + slope * trees.log_odds(x)
            if name == "lifted" and features["guessed"] > 0.0:
                odds = self.guessed[0] + self.guessed[1] * odds
            # standard deviations of the members' log odds, to either side
            middle, around = odds.mean(), 1.96 * odds.std()
            found[name] = Chance(*(_share(each) for each in (middle, middle - around, middle + around)))
        return found


def _share(log_odds: float) -> float:
    return round(float(1.0 / (1.0 + np.exp(-log_odds))), 6)


def probability_of(record: GraspRecord, guessed: float = 0.0) -> HoldsProbability | None:
    """Return the probability that a grasp holds an object as heavy as assumed, at the friction that it counts on.

    Args:
        record: the grasp.
        guessed: m, mean error expected of the surface at the contacts where no camera saw it; else 0.

    Returns:
        By the shipped model; None for a grasp of a kind that no trials have tested.
    """
    model = shipped_model()
    friction, mass = round(record.thresholds.friction_hold / HOLD_SHARE, 9), record.certificate.mass
    of_others = record.robot.hash != model.robot or record.neighbours
    asked = record.request is not None and record.request.constrains
    if of_others or friction < FRICTION or asked or not mass > 0.0:
        return None
    chances = model.chances(features_of(record, friction, mass, guessed))
    return HoldsProbability(model.hash, friction, mass, guessed, **chances)


@lru_cache(maxsize=1)
def shipped_model() -> Model:
    """Return the model that comes with the package."""
    content = read_file(asset_path("weights/probability.json"))
    stated = json.loads(content)
    outcomes = {name: _outcome(stated["outcomes"][name]) for name in OUTCOMES}
    features = tuple(stated["features"])
    return Model(content_hash(content), stated["robot"], features, outcomes, tuple(stated["guessed"]))


def _outcome(stated: Fields) -> tuple[Trees, tuple[float, float]]:
    whole = ("feature", "left", "right", "roots", "member")
    columns = {name: np.array(stated[name], dtype=int if name in whole else float) for name in Trees._fields}
    offset, slope = stated["calibration"]
    return Trees(**columns), (offset, slope)
