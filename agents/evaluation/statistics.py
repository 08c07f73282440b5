"""Statistics of successes: intervals, quantiles, paired comparison."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

Z95 = 1.959963984540054


def wilson_interval(successes: int, trials: int, z: float = Z95) -> tuple[float, float]:
    """Return Wilson's score interval of a rate (Wilson 1927); [0, 1] without trials.

    Raises:
        ValueError: unless 0 <= successes <= trials.
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials")
    if trials == 0:
        return 0.0, 1.0
    rate, z2 = successes / trials, z * z
    centre = rate + z2 / (2 * trials)
    half = z * math.sqrt(rate * (1 - rate) / trials + z2 / (4 * trials**2))
    scale = 1 + z2 / trials
    # At 0 and n the ends are 0 and 1 exactly; rounding must not leave them a hair inside.
    low = 0.0 if successes == 0 else (centre - half) / scale
    high = 1.0 if successes == trials else (centre + half) / scale
    return low, high


def quantiles(values: Sequence[float], **named: float) -> dict[str, float]:
    """Return named quantiles (linear interpolation), e.g. `quantiles(x, median=0.5)`; {} without values."""
    if not values:
        return {}
    return {name: float(np.quantile(np.asarray(values, dtype=float), level)) for name, level in named.items()}


def mcnemar(a: Mapping[object, bool], b: Mapping[object, bool]) -> dict[str, float | int]:
    """Compare two agents on the scenes that both have tried.

    Args:
        a: scene -> success of the first.
        b: scene -> success of the second.

    Returns:
        Counts both, only_a, only_b, neither, and p_value of the exact two-sided McNemar test: how likely so uneven a
        split of the scenes that only one of them solved is if both are equally good.
    """
    scenes = [key for key in a if key in b]
    only_a = sum(a[key] and not b[key] for key in scenes)
    only_b = sum(b[key] and not a[key] for key in scenes)
    both = sum(a[key] and b[key] for key in scenes)
    return {
        "both": both, "only_a": only_a, "only_b": only_b, "neither": len(scenes) - both - only_a - only_b,
        "p_value": _two_sided_half(min(only_a, only_b), only_a + only_b),
    }  # fmt: skip


def _two_sided_half(least: int, total: int) -> float:
    """P of a fair coin: at most `least` or at least `total - least` heads of `total`."""
    tail = sum(math.comb(total, k) for k in range(least + 1)) / 2**total
    return min(1.0, 2.0 * tail)
