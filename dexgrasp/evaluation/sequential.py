"""Stopping early: a paired test that may be looked at after every scene.

Scenes that both agents solve, or neither, say nothing of which is better. If both are equally good, each scene that one
alone solves is the toss of a fair coin. A bettor against that coin who stakes by the mixture of Krichevsky and Trofimov
has, after a heads and b tails, the capital

    E(a, b) = 2^(a+b) B(a + 1/2, b + 1/2) / B(1/2, 1/2),

a martingale of mean 1 if the coin is fair. So the chance that it ever reaches 1 / level, however often one looks and
whenever one stops, is at most level (Ville 1939; mixtures: Robbins 1970; Ramdas et al. 2023, "Game-theoretic statistics
and safe anytime-valid inference"). No correction for looks is needed; the price is that it sees a difference somewhat
later than the exact McNemar test would at the one right moment.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import combinations, permutations

import numpy as np
from scipy.special import betaln

from dexgrasp_env.arrays import Fields

Key = tuple[str, str, int]
"""Agent, object, trial."""

_PRIOR = 0.5  # Krichevsky and Trofimov: bets on lopsided coins, as agents of different quality are


def capital(only_a: int, only_b: int) -> float:
    """Return the bettor's capital E after that many scenes that one of the two alone solved."""
    log = (only_a + only_b) * np.log(2.0) + betaln(only_a + _PRIOR, only_b + _PRIOR) - betaln(_PRIOR, _PRIOR)
    return float(np.exp(min(log, 700.0)))


def is_decided(only_a: int, only_b: int, level: float = 0.05) -> bool:
    """Whether one is shown to be better, with a chance of at most `level` to say so of equals at any time."""
    return capital(only_a, only_b) >= 1.0 / level


def decided_after(
    planned: Iterable[Key], rows: Sequence[Fields], agents: Sequence[str], level: float = 0.05
) -> int | None:
    """Return after how many trials of each agent on each object every pair of agents is decided; None if it is not.

    Only whole rounds (trial k of everything) are looked at, so the answer does not depend on the order in which trials
    end. With more than two agents the level is shared among the pairs (Bonferroni).

    Args:
        planned: (agent, object, trial) of every trial of the evaluation.
        rows: finished trials.
        agents: their names.
        level: chance that any pair of equals is called different.
    """
    won = {(row["agent"], row["object"], row["trial"]): row["success"] for row in rows}
    rounds: dict[int, set[Key]] = {}
    for key in planned:
        rounds.setdefault(key[2], set()).add(key)
    pairs = list(combinations(agents, 2))
    alone = Counter[tuple[str, str]]()  # scenes that the first of two solved and the second did not
    for number, keys in sorted(rounds.items()):
        if not pairs or not keys <= won.keys():
            return None
        for a, b in permutations(agents, 2):
            alone[a, b] += sum(won[a, *scene] > won[b, *scene] for scene in {key[1:] for key in keys})
        if all(is_decided(alone[a, b], alone[b, a], level / len(pairs)) for a, b in pairs):
            return number + 1
    return None
