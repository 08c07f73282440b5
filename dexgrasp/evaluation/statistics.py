"""Statistics of successes: intervals of a rate, of a set of objects and of a paired difference.

Trials on the same object are not independent: what is claimed for new objects rests on the number of objects, and its
interval comes from drawing objects, not trials. Nor are those of one scene under several conditions: the scene is the
unit of intervals and tests, however many conditions it is met under.
"""

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence

import numpy as np
from scipy.stats import binomtest, bootstrap, norm

from dexgrasp_env.arrays import Array, Fields

Counts = Mapping[str, tuple[int, int]]
"""Object -> (successes, trials)."""
Interval = tuple[float, float]

_LEVEL = 0.95
_QUANTILE = float(norm.ppf(0.5 + 0.5 * _LEVEL))


def wilson_interval(successes: float, trials: float) -> Interval:
    """Return Wilson's 95 % score interval of a rate (Wilson 1927); [0, 1] without trials.

    Numbers need not be whole: trials that depend on each other count as fewer.

    Raises:
        ValueError: unless 0 <= successes <= trials.
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials")
    if trials == 0:
        return 0.0, 1.0
    squared, failures = _QUANTILE**2, trials - successes
    middle = (successes + 0.5 * squared) / (trials + squared)
    half = _QUANTILE * math.sqrt(successes * failures / trials + 0.25 * squared) / (trials + squared)
    # At 0 and n the ends are 0 and 1 exactly; rounding must not leave them a hair inside.
    return (0.0 if successes == 0 else middle - half), (1.0 if failures == 0 else middle + half)


def cluster_interval(rate: float, moved: Iterable[tuple[Hashable, float]], trials: int) -> Interval:
    """Return a 95 % interval of a rate of trials that are not independent within a scene.

    Wilson's at the number of independent trials that would give the rate the same variance, from the scenes' number to
    the trials'; exact where every scene is met once.

    Args:
        rate: weighted mean of outcomes.
        moved: scene of every outcome, and by how much it moves the rate: weight times (outcome - mean).
        trials: outcomes.
    """
    scatter: dict[Hashable, float] = {}
    for scene, share in moved:
        scatter[scene] = scatter.get(scene, 0.0) + share
    variance = sum(share**2 for share in scatter.values())
    alike = rate * (1.0 - rate) / variance if variance > 0.0 else 0.0
    number = min(max(round(alike, 6), len(scatter)), trials)
    return wilson_interval(min(rate * number, number), number)


def quantiles(values: Sequence[float], **named: float) -> dict[str, float]:
    """Return named quantiles (linear interpolation), e.g. `quantiles(x, median=0.5)`; {} without values."""
    if not values:
        return {}
    return {name: float(np.quantile(np.asarray(values, dtype=float), level)) for name, level in named.items()}


def _sign_test(a: int, b: int) -> float:
    """Return the p value of the exact two-sided test that one side wins as often as the other."""
    return float(binomtest(a, a + b, 0.5).pvalue) if a + b else 1.0


def paired_comparison(outcomes: Iterable[tuple[Hashable, bool, bool]]) -> Fields:
    """Compare two agents on the same scenes, each met under one condition or several.

    Args:
        outcomes: scene, success of the first and of the second, of every trial.

    Returns:
        trials and scenes; both, only_a, only_b and neither of the trials; for_a and for_b, scenes of which one solved
        more trials than the other; p_value of the exact two-sided sign test on these, which is McNemar's where every
        scene is met once; difference of the rates and its 95 % interval ci95, Newcombe's for as many trials as would,
        were they independent, scatter as the scenes do.
    """
    scenes: dict[Hashable, list[tuple[bool, bool]]] = {}
    for scene, a, b in outcomes:
        scenes.setdefault(scene, []).append((a, b))
    met = scenes.values()
    counts = Counter(pair for own in met for pair in own)
    cells = [counts[pair] for pair in ((True, True), (True, False), (False, True), (False, False))]
    by_scene = [sum(a - b for a, b in own) for own in met]
    for_a, for_b = sum(d > 0 for d in by_scene), sum(d < 0 for d in by_scene)
    trials = sum(cells)
    each = max(trials, 1) / max(len(scenes), 1)
    difference = sum(by_scene) / max(trials, 1)
    # What trials of a scene share makes them scatter more than independent ones.
    alone = cells[1] + cells[2] - trials * difference**2
    off = sum((d - len(own) * difference) ** 2 for d, own in zip(by_scene, met, strict=True))
    fewer = max(min(off / alone, each) if alone > 1e-9 else each, 1.0)
    return dict(zip(("both", "only_a", "only_b", "neither"), cells, strict=True)) | {
        "trials": trials, "scenes": len(scenes), "for_a": for_a, "for_b": for_b, "p_value": _sign_test(for_a, for_b),
        "difference": difference, "ci95": list(paired_difference_interval(*(n / fewer for n in cells))),
    }  # fmt: skip


def paired_difference_interval(both: float, only_a: float, only_b: float, neither: float) -> Interval:
    """Return a 95 % interval of rate(a) - rate(b) on the same scenes; [-1, 1] without scenes.

    Newcombe (1998), "Improved confidence intervals for the difference between binomial proportions based on paired
    data", method 10: the two Wilson intervals, squared and added with their correlation.
    """
    n = both + only_a + only_b + neither
    if n == 0:
        return -1.0, 1.0
    rate_a, rate_b = (both + only_a) / n, (both + only_b) / n
    low_a, high_a = wilson_interval(both + only_a, n)
    low_b, high_b = wilson_interval(both + only_b, n)
    phi = _phi(both, only_a, only_b, neither)

    def reach(x: float, y: float) -> float:
        """Return how far an end of the interval is from the difference, by the ends of the two rates."""
        return math.sqrt(max(x * x - 2.0 * phi * x * y + y * y, 0.0))

    difference = rate_a - rate_b
    low = difference - reach(rate_a - low_a, high_b - rate_b)
    return low, difference + reach(high_a - rate_a, rate_b - low_b)


def _phi(both: float, only_a: float, only_b: float, neither: float) -> float:
    """Correlation of the two outcomes, with Newcombe's continuity correction where it is positive."""
    n = both + only_a + only_b + neither
    margins = (both + only_a) * (only_b + neither) * (both + only_b) * (only_a + neither)
    if margins == 0.0:
        return 0.0
    determinant = both * neither - only_a * only_b
    if determinant > 0:
        determinant = max(determinant - 0.5 * n, 0.0)
    return determinant / math.sqrt(margins)


def object_interval(counts: Counts) -> Interval:
    """Return a 95 % interval of the rate on objects like these: objects are drawn anew, with all of their trials.

    Where every object has the same rate (all of them always held, say) there is nothing to draw from: then Wilson's
    interval with each object as one trial. Percentile bootstrap (Efron 1979); with under ten objects it is too narrow.
    """
    k, n = _columns(counts)
    rates = np.divide(k, n, out=np.zeros(len(k)), where=n > 0)
    if len(rates) < 2 or np.ptp(rates) == 0.0:
        return wilson_interval(round(float(rates.sum())), len(rates))
    return _bootstrap((k, n), lambda a, b, axis: a.sum(axis) / b.sum(axis))


def object_difference_interval(a: Counts, b: Counts) -> Interval:
    """Return a 95 % interval of rate(a) - rate(b) on objects like these, both tried on the same; [-1, 1] under two.

    Where the difference is the same for every object there is nothing to draw from: then Newcombe's interval with each
    object as one trial.
    """
    names = [name for name in a if name in b]
    if len(names) < 2:
        return -1.0, 1.0
    first, second = (_columns({name: counts[name] for name in names}) for counts in (a, b))
    rates = second[0] / second[1]
    differences = first[0] / first[1] - rates
    if np.ptp(differences) < 1e-12:
        alone = len(names) * float(differences[0])
        both = float(rates.sum()) - max(-alone, 0.0)
        return paired_difference_interval(
            both, max(alone, 0.0), max(-alone, 0.0), max(len(names) - both - abs(alone), 0.0)
        )
    return _bootstrap(
        (*first, *second),
        lambda ka, na, kb, nb, axis: ka.sum(axis) / na.sum(axis) - kb.sum(axis) / nb.sum(axis),
    )


def _columns(counts: Counts) -> tuple[Array, Array]:
    """Return successes and trials of the objects, in the order of their names, which is any run's."""
    pairs = np.array([counts[name] for name in sorted(counts)], dtype=float).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _bootstrap(columns: tuple[Array, ...], statistic: object) -> Interval:
    found = bootstrap(
        columns, statistic, paired=True, vectorized=True, n_resamples=9999, confidence_level=_LEVEL,
        method="percentile", rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    return float(found.low), float(found.high)
