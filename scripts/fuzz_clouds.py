"""Odd clouds for `fuzz.py`: boxes, cylinders, domes and walls on a table, up to three damages, something pointed at."""

from collections.abc import Callable
from pathlib import Path

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


def wall(rng: Generator) -> Points:
    """Points of an upright sheet, (N, 3) m."""
    size = rng.uniform([0.1, 0.002, 0.03], [0.5, 0.01, 0.15])
    points = rng.uniform(-0.5, 0.5, (rng.integers(30, 4000), 3)) * size + [0.0, 0.0, 0.5 * size[2]]
    turn = rng.uniform(0.0, np.pi)
    R = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    return points @ R.T + [rng.uniform(0.35, 0.70), rng.uniform(-0.3, 0.3), 0.0]


def odd_cloud(rng: Generator) -> Points:
    """Draw a scene, (N, 3) m, of one thing or a few and walls, with up to three damages."""
    few = rng.integers(0, [6, 3]) * (rng.random() < 0.6)
    more = [make(rng) for make, count in zip((thing, wall), few, strict=True) for _ in range(count)]
    points = np.concatenate([table(rng), thing(rng), *more])
    for k in rng.choice(len(DAMAGES), rng.integers(0, 4), replace=False):
        if len(points):
            points = DAMAGES[k](points, rng)
    return points


def odd_pointing(points: Points, rng: Generator, folder: Path) -> list[str]:
    """Draw options that point at something in a cloud, or at nothing."""
    n = len(points)
    at = (
        points[rng.integers(n)]
        if n and rng.random() < 0.8
        else rng.choice([0.0, 0.5, -3.0, np.nan, 1e300], 3)
    )
    size = rng.choice([0.005, 0.05, 0.1, 1.0, -0.1])
    masks = (
        lambda: np.linalg.norm(points - at, axis=1) < size,
        lambda: (points @ rng.normal(size=3) * rng.choice([1.0, 30.0, 1e6])).astype(int),
        lambda: rng.integers(-1, 4, n),
        lambda: np.zeros(n, bool),
        lambda: np.ones(n + rng.integers(2), bool),
        lambda: rng.random(n),
        lambda: np.array("mask"),
    )
    kind = rng.integers(5)
    if kind == 0:
        return []
    if kind == 1:
        return ["--object-near", *map(str, at)]
    if kind == 2:
        return ["--box", *map(str, [*(at - size), *(at + size)])]
    with np.errstate(all="ignore"):
        np.save(folder / "mask.npy", masks[rng.integers(len(masks))]())
    label = ["--label", str(rng.integers(-1, 4))] if rng.random() < 0.4 else []
    return ["--mask", str(folder / "mask.npy"), *label]
