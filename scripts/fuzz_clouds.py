"""Odd clouds for `fuzz.py`: a table with a box, a cylinder or a dome on it, and up to three damages."""

from collections.abc import Callable

import numpy as np
from fuzz_inputs import MOVES
from numpy.random import Generator
from numpy.typing import NDArray

Points = NDArray[np.float64]


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


def _holed(points: Points, rng: Generator) -> Points:
    return points[np.linalg.norm(points - points[rng.integers(len(points))], axis=1) > rng.uniform(0.01, 0.1)]


DAMAGES: tuple[Callable[[Points, Generator], Points], ...] = (
    *MOVES,
    _holed,
    lambda points, rng: np.concatenate([points, rng.uniform(-0.2, 0.9, (rng.integers(1, 500), 3))]),
    lambda points, rng: points[(points - points.mean(0)) @ rng.normal(size=3) > 0.0],
    lambda points, rng: points[rng.integers(0, len(points), rng.integers(0, 60))],
    lambda points, rng: np.repeat(points[: max(1, len(points) // 50)], 50, axis=0),
    lambda points, rng: np.concatenate([points, thing(rng)]),
    lambda points, rng: points[points[:, 2] > 0.004],
)
"""Besides moves: a hole, flying pixels, one side alone, few points, repeated ones, a second object, no table."""


def odd_cloud(rng: Generator) -> Points:
    """Draw a scene, (N, 3) m, with up to three damages."""
    points = np.concatenate([table(rng), thing(rng)])
    for k in rng.choice(len(DAMAGES), rng.integers(0, 4), replace=False):
        if len(points):
            points = DAMAGES[k](points, rng)
    return points
