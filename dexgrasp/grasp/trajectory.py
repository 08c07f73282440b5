"""Trajectories of set-points: the script of a grasp, and the measures of a way that planner and judge share."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dexgrasp_env.arrays import Array


@dataclass(frozen=True)
class ActionScript:
    """Set-points of an episode.

    Attributes:
        phases: (k, n) rad of each phase, one a control step, by its name: approach, close, squeeze, lift, hold.
        start: (n,) rad, set-points before the first step.
    """

    phases: Mapping[str, Array]
    start: Array

    @cached_property
    def targets(self) -> Array:
        """Set-points (T, n) rad of all phases."""
        return np.concatenate(list(self.phases.values()))

    def way(self, phase: str) -> Array:
        """Return the set-points (k + 1, n) rad of a phase, from those before it on."""
        before = dict(zip(self.phases, [self.start[None], *self.phases.values()], strict=False))
        return np.concatenate([before[phase][-1:], self.phases[phase]])

    def at(self, step: int) -> Array:
        """Return the set-points (n,) rad of a step from 0 on; the last are held."""
        return self.targets[min(step, len(self.targets) - 1)]


def bend(rows: Array) -> float:
    """Return how far, rad, set-points (T, 23) stand out of the plane (or line) of two neighbours on either side.

    Straight ways and rounded corners lie in such planes; a single set-point that was changed does not.
    """
    inner = np.arange(1, len(rows) - 1)
    near = np.clip(inner[:, None] + [-2, -1, 1, 2], 0, len(rows) - 1)
    return _stands_out(rows[inner], rows[near]) if len(inner) else 0.0


def _stands_out(rows: Array, near: Array) -> float:
    """Return how far at most rows (K, 23) are from the planes of K sets of neighbours (K, n, 23)."""
    middle = near.mean(1)
    _, spread, directions = np.linalg.svd(near - middle[:, None], full_matrices=False)
    # of the spread of neighbours: less across their main direction is a line
    spans = spread[:, :2] > np.maximum(1e-7 * spread[:, :1], 1e-9)
    spanned = directions[:, :2] * spans[:, :, None]
    off = rows - middle
    along = np.einsum("knj,kj->kn", spanned, off)
    return float(np.abs(off - np.einsum("kn,knj->kj", along, spanned)).max())


def stray(positions: Array, rotations: Array) -> float:
    """Return how far, m, a palm at `positions` (T, 3), `rotations` (T, 3, 3) strays from straight up without a turn."""
    aside = np.linalg.norm(positions[:, :2] - positions[0, :2], axis=1)
    turn = Rotation.from_matrix(rotations @ rotations[0].T).magnitude()
    return float(np.hypot(aside, 0.15 * turn).max())  # a radian counts as 0.15 m


def jerkiness(rows: Array) -> float:
    """Return how far, rad, set-points (T, 23) from rest to rest lie from the cubic through two on either side."""
    P = np.concatenate([rows[:1], rows[:1], rows, rows[-1:], rows[-1:]])
    return float(np.abs((-P[:-4] + 4.0 * P[1:-3] + 4.0 * P[3:-1] - P[4:]) / 6.0 - rows).max())


def densify(path: ArrayLike, step: float = 0.01) -> Array:
    """Return points (m, n) on a polyline (k, n), corners included, no joint moving over `step` rad."""
    path = np.asarray(path, dtype=float)
    way = np.diff(path, axis=0)
    counts = np.maximum(np.ceil(np.abs(way).max(axis=1) / step), 1).astype(int)
    leg = np.repeat(np.arange(len(way)), counts)
    number = np.arange(1, len(leg) + 1) - (np.cumsum(counts) - counts)[leg]
    return np.concatenate([path[:1], path[leg] + (number / counts[leg])[:, None] * way[leg]])


def limit_shares(rows: Array, period: float, *limits: Array) -> list[float]:
    """Return the largest share that rows (T, n), from rest to rest, use of limits of velocity, acceleration, jerk.

    At rest before the first row and after the last: a jump at either end is motion too.
    """
    order = len(limits)
    still = np.concatenate([np.repeat(rows[:1], order, axis=0), rows, np.repeat(rows[-1:], order, axis=0)])
    return [
        float((np.abs(np.diff(still, n=n, axis=0)) / period**n / limit).max())
        for n, limit in enumerate(limits, start=1)
    ]
