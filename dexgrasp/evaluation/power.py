"""How many trials it takes to see a difference, before they are run."""

from bisect import bisect_left
from collections.abc import Callable

import numpy as np
from scipy.special import ndtri
from scipy.stats import binom

from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError

_SCENES = tuple(2**k for k in range(3, 18))
"""What the search for enough scenes tries first."""
_POWER, _LEVEL = 0.8, 0.05
"""The chance to see the difference, and the level of the two-sided test."""


def unpaired_trials(rate: float, difference: float) -> int:
    """Return the trials of each agent, on scenes of their own, that show `difference` below `rate`.

    Two-sided comparison of two proportions (Fleiss, Levin and Paik 2003, eq. 4.14, without continuity correction).

    Raises:
        InputError: unless 0 < difference < rate <= 1.
    """
    if not 0.0 < difference < rate <= 1.0:
        raise InputError(
            f"difference {difference:g} below rate {rate:g}: valid is 0 < difference < rate <= 1"
        )
    a, b = rate, rate - difference
    mean = 0.5 * (a + b)
    null = ndtri(1 - _LEVEL / 2) * np.sqrt(2 * mean * (1 - mean))
    other = ndtri(_POWER) * np.sqrt(a * (1 - a) + b * (1 - b))
    return int(np.ceil(((null + other) / difference) ** 2))


def paired_trials(difference: float, discordant: float) -> int:
    """Return the scenes, tried by both agents, that show `difference` by the exact McNemar test.

    Args:
        difference: of the two rates.
        discordant: share of the scenes that one of the two alone solves, at least `difference`.

    Raises:
        InputError: unless 0 < difference <= discordant <= 1.
    """
    if not 0.0 < difference <= discordant <= 1.0:
        raise InputError(
            f"difference {difference:g}, discordant share {discordant:g}: valid is 0 < difference <= share <= 1"
        )
    return _least(lambda n: paired_power(n, difference, discordant) >= _POWER)


def paired_power(scenes: int, difference: float, discordant: float) -> float:
    """Return the chance that the exact McNemar test sees the difference on that many scenes."""
    d = np.arange(scenes + 1)
    share = 0.5 * (1.0 + difference / discordant)
    # The largest c with 2 P(fair coin <= c of d) <= level: rejected at c or less, or d - c or more.
    edge = binom.ppf(_LEVEL / 2, d, 0.5)
    edge = np.where(2.0 * binom.cdf(edge, d, 0.5) > _LEVEL, edge - 1, edge)
    seen = binom.cdf(edge, d, share) + binom.sf(d - edge - 1, d, share)
    return float((binom.pmf(d, scenes, discordant) * seen).sum())


def independent_discordance(rate: float, difference: float) -> float:
    """Return the share of scenes that one alone solves where the scenes have nothing in common (the worst case)."""
    other = rate - difference
    share = rate * (1 - other) + other * (1 - rate)
    return max(share, difference)  # equal at a rate of 1, where rounding would make it less


def power_figures(difference: float, rate: float, agents: int, objects: int) -> Fields:
    """Return what `evaluate --power` says: the trials needed, by design, at 80 % power and the 5 % level.

    Raises:
        InputError: unless 0 < difference < rate <= 1.
    """
    unpaired = unpaired_trials(rate, difference)
    worst = paired_trials(difference, independent_discordance(rate, difference))
    return {
        "difference": difference,
        "rate": rate,
        "power": _POWER,
        "level": _LEVEL,
        "unpaired_trials_an_agent": unpaired,
        "paired_scenes_at_most": worst,
        "paired_scenes_at_least": paired_trials(difference, difference),
        "objects": objects,
        "trials_an_object": -(-worst // objects),
        "trials_in_all": agents * objects * -(-worst // objects),
    }


def power_sentences(figures: Fields) -> list[str]:
    """Return the figures in words."""
    other, objects = figures["rate"] - figures["difference"], figures["objects"]
    return [
        f"To tell {figures['rate']:.1%} from {other:.1%} with a chance of 80 % at the 5 % level (two-sided):",
        f"  scenes of its own for each agent: {figures['unpaired_trials_an_agent']} trials an agent",
        f"  the same scenes (exact McNemar): {figures['paired_scenes_at_least']} scenes if the weaker agent solves "
        f"nothing that the other does not, {figures['paired_scenes_at_most']} if scenes have nothing in common",
        f"  so --trials {figures['trials_an_object']} on {objects} object{'s' * (objects != 1)}: "
        f"{figures['trials_in_all']} trials in all",
    ]


def _least(enough: Callable[[int], bool]) -> int:
    """Return the least n from which on it is enough; power of an exact test wobbles by steps of a few scenes."""
    high = next((n for n in _SCENES if enough(n)), None)
    if high is None:
        raise InputError(f"more than {_SCENES[-1]} scenes would be needed: ask for a larger difference")
    least = bisect_left(range(high), True, lo=high // 2, key=enough)
    while not all(enough(least + step) for step in range(6)):
        least += 1
    return least
