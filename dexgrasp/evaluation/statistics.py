"""Statistics of successes: intervals of a rate and of a paired difference, and the test of that difference.

Trials of one scene under several conditions are not independent, nor are those of one object. A claim about the tried
objects has the scene as its unit, a claim about objects like these the object. Every interval is a score interval at
the effective number of trials: the independent ones that would have the same variance. Tests invert these intervals.
"""

import math
from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm, t

from dexgrasp_env.arrays import Fields

Counts = Mapping[str, tuple[int, int]]
"""Object -> (successes, trials)."""
Interval = tuple[float, float]

_NORMAL = float(norm.ppf(0.975))
"""Quantile of 95 % intervals."""


def wilson_interval(successes: float, trials: float, quantile: float = _NORMAL) -> Interval:
    """Return Wilson's score interval of a rate (Wilson 1927), by default of 95 %; [0, 1] without trials.

    Counts need not be whole, as effective numbers of dependent trials are not.

    Raises:
        ValueError: unless 0 <= successes <= trials.
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials")
    if trials == 0:
        return 0.0, 1.0
    squared, failures = quantile**2, trials - successes
    middle = (successes + 0.5 * squared) / (trials + squared)
    half = quantile * math.sqrt(successes * failures / trials + 0.25 * squared) / (trials + squared)
    # At 0 and n the ends are 0 and 1 exactly; rounding must not leave them a hair inside.
    return (0.0 if successes == 0 else middle - half), (1.0 if failures == 0 else middle + half)


def cluster_interval(
    rate: float, moved: Iterable[tuple[Hashable, float]], trials: int, quantile: float = _NORMAL
) -> Interval:
    """Return a 95 % interval of a rate whose trials are clustered by unit: a scene, an object.

    Wilson's interval at the effective number of trials, at least the number of units and at most that of trials; it is
    the usual one where every unit has one trial.

    Args:
        rate: weighted mean of outcomes.
        moved: unit and contribution to the rate, weight times (outcome - mean), of every outcome.
        trials: number of outcomes.
        quantile: of the normal or Student distribution.
    """
    scatter: dict[Hashable, float] = {}
    for unit, share in moved:
        scatter[unit] = scatter.get(unit, 0.0) + share
    variance = sum(share**2 for share in scatter.values())
    alike = rate * (1.0 - rate) / variance if variance > 0.0 else 0.0
    number = min(max(round(alike, 6), len(scatter)), trials)
    return wilson_interval(min(rate * number, number), number, quantile)


def _student(units: int) -> float:
    """Return Student's quantile of a 95 % interval whose variance is estimated from a number of units."""
    return float(t.ppf(0.975, max(units - 1, 1)))


def quantiles(values: Sequence[float], **named: float) -> dict[str, float]:
    """Return named quantiles (linear interpolation), e.g. `quantiles(x, median=0.5)`; {} without values."""
    if not values:
        return {}
    return {name: float(np.quantile(np.asarray(values, dtype=float), level)) for name, level in named.items()}


def paired_comparison(outcomes: Iterable[tuple[Hashable, bool, bool]]) -> Fields:
    """Compare two agents on the same trials, which are clustered by unit: a scene, an object.

    Args:
        outcomes: unit, success of the first and of the second agent, of every trial.

    Returns:
        trials; units; both, only_a, only_b and neither, counts of trials; difference of the rates; its 95 % interval
        ci95, Newcombe's at the effective number of trials; and p_value, the level at which that interval ends at 0, so
        that p_value < 0.05 where ci95 excludes 0.
    """
    units: dict[Hashable, list[tuple[bool, bool]]] = {}
    for unit, a, b in outcomes:
        units.setdefault(unit, []).append((a, b))
    counts = Counter(pair for own in units.values() for pair in own)
    cells = [counts[pair] for pair in ((True, True), (True, False), (False, True), (False, False))]
    trials = sum(cells)
    difference = (cells[1] - cells[2]) / max(trials, 1)
    fewer = _design_effect(units.values(), cells, difference)

    def interval(quantile: float) -> Interval:
        """Return the interval of the difference at a quantile."""
        both, only_a, only_b, neither = (n / fewer for n in cells)
        return paired_difference_interval(both, only_a, only_b, neither, quantile)

    def above_zero(quantile: float) -> float:
        """Return the signed distance of the nearer end of the interval from 0; negative where it includes 0."""
        low, high = interval(quantile)
        return low if difference > 0 else -high

    ends_at_zero = 0.0
    if difference:
        farthest = 40.0  # largest quantile that is searched
        ends_at_zero = brentq(above_zero, 0.0, farthest) if above_zero(farthest) < 0.0 else farthest
    p_value = 2.0 * float(t.sf(ends_at_zero, max(len(units) - 1, 1)))
    return dict(zip(("both", "only_a", "only_b", "neither"), cells, strict=True)) | {
        "trials": trials, "units": len(units), "difference": difference, "ci95": list(interval(_student(len(units)))),
        "p_value": p_value,
    }  # fmt: skip


def _design_effect(
    units: Collection[list[tuple[bool, bool]]], cells: Sequence[int], difference: float
) -> float:
    """Return the design effect: trials per independent trial, from 1 to the mean number of trials in a unit."""
    trials, number = max(sum(cells), 1), max(len(units), 1)
    alone = cells[1] + cells[2] - trials * difference**2
    off = sum((sum(a - b for a, b in own) - len(own) * difference) ** 2 for own in units)
    off *= number / max(number - 1, 1)
    each = trials / number
    return max(min(off / alone, each) if alone > 1e-9 else each, 1.0)


def paired_difference_interval(
    both: float, only_a: float, only_b: float, neither: float, quantile: float = _NORMAL
) -> Interval:
    """Return an interval of rate(a) - rate(b) on the same scenes, by default of 95 %; [-1, 1] without scenes.

    Newcombe (1998), "Improved confidence intervals for the difference between binomial proportions based on paired
    data", method 10: the two Wilson intervals, squared and added with their correlation.
    """
    n = both + only_a + only_b + neither
    if n == 0:
        return -1.0, 1.0
    rate_a, rate_b = (both + only_a) / n, (both + only_b) / n
    low_a, high_a = wilson_interval(both + only_a, n, quantile)
    low_b, high_b = wilson_interval(both + only_b, n, quantile)
    phi = _phi(both, only_a, only_b, neither)

    def reach(x: float, y: float) -> float:
        """Return the distance of an end of the interval from the difference, from the ends of both rates."""
        return math.sqrt(max(x * x - 2.0 * phi * x * y + y * y, 0.0))

    difference = rate_a - rate_b
    low = difference - reach(rate_a - low_a, high_b - rate_b)
    return low, difference + reach(high_a - rate_a, rate_b - low_b)


def _phi(both: float, only_a: float, only_b: float, neither: float) -> float:
    """Return the correlation of both outcomes, with Newcombe's continuity correction where it is positive."""
    n = both + only_a + only_b + neither
    margins = (both + only_a) * (only_b + neither) * (both + only_b) * (only_a + neither)
    if margins == 0.0:
        return 0.0
    determinant = both * neither - only_a * only_b
    if determinant > 0:
        determinant = max(determinant - 0.5 * n, 0.0)
    return determinant / math.sqrt(margins)


def object_interval(counts: Counts) -> Interval:
    """Return a 95 % interval of the rate on objects like these, with the object as the unit; [0, 1] without any."""
    trials = sum(n for _, n in counts.values())
    if len(counts) < 2:
        return wilson_interval(sum(k for k, _ in counts.values()) / max(trials, 1), len(counts))
    rate = sum(k for k, _ in counts.values()) / trials
    share = math.sqrt(len(counts) / (len(counts) - 1)) / trials
    moved = [(name, (k - n * rate) * share) for name, (k, n) in sorted(counts.items())]
    return cluster_interval(rate, moved, trials, _student(len(counts)))
