"""Counts of protocols that are made of others: two parts, or all eight."""

from collections.abc import Mapping, Sequence
from typing import Any

from dexgrasp.evaluation.protocol import GROUPS
from dexgrasp.evaluation.rows import row_key
from dexgrasp.evaluation.statistics import scattered_interval
from dexgrasp_env.arrays import Fields

_WEAKER, _STRONGER = "pushed@0.5", "pushed@1"
NOT_HELD_BEFORE = "failed_pushed@0.5"


def judged(rows: Sequence[Fields]) -> list[Fields]:
    """Return the trials with `pushed@1` a failure where the same scene was one under `pushed@0.5`."""
    lost = {row_key(row)[1:] for row in rows if row["protocol"] == _WEAKER and not row["success"]}
    return [
        {**row, "success": False, "reason": NOT_HELD_BEFORE}
        if row["protocol"] == _STRONGER and row["success"] and row_key(row)[1:] in lost
        else row
        for row in rows
    ]


def scene_of(row: Fields) -> tuple[Any, ...]:
    """Return what a trial shares with those of the same scene under other conditions."""
    return row["object"], row["trial"], row.get("scene_seed")


def protocol_counts(rows: Mapping[str, Sequence[Fields]]) -> dict[str, Fields]:
    """Return trials, successes, rate and 95 % interval of each protocol, and of those made of them that are whole."""
    weights = {name: {name: 1.0} for name in rows}
    for group, names in GROUPS.items():
        own = [weights.get(name, {name: 1.0}) for name in names]
        weights[group] = {part: w / len(names) for each in own for part, w in each.items()}
    return {
        name: pooled([rows[part] for part in own], list(own.values()))
        for name, own in weights.items()
        if own.keys() <= rows.keys()
    }


def pooled(parts: Sequence[Sequence[Fields]], weights: Sequence[float] = (1.0,)) -> Fields:
    """Return trials, successes and 95 % interval of parts, which may meet the same scenes, and their mean rate."""
    total, wins, rate = 0, 0, 0.0
    moved = list[tuple[Any, float]]()
    for rows, weight in zip(parts, weights, strict=True):
        n, k = len(rows), sum(bool(row["success"]) for row in rows)
        own = k / n if n else 0.0
        total, wins = total + n, wins + k
        rate += weight * own
        moved += [(scene_of(row), weight / n * (bool(row["success"]) - own)) for row in rows]
    interval = scattered_interval(rate, moved, total)
    return {"trials": total, "successes": wins, "rate": rate, "ci95": list(interval)}
