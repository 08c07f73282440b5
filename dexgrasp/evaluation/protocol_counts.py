"""Counts of protocols that are made of others: two parts, or all eight."""

from collections.abc import Mapping, Sequence
from typing import Any

from dexgrasp.evaluation.protocol import GROUPS, ROBUST
from dexgrasp.evaluation.statistics import wilson_interval

Row = Mapping[str, Any]
_WEAKER, _STRONGER = "pushed@0.5", "pushed@1"
NOT_HELD_BEFORE = "failed_pushed@0.5"


def judged(rows: Sequence[Row]) -> list[Row]:
    """Return the trials with `pushed@1` a failure where the same scene was one under `pushed@0.5`."""
    lost = {_scene(row) for row in rows if row.get("protocol") == _WEAKER and not row["success"]}
    return [
        {**row, "success": False, "reason": NOT_HELD_BEFORE}
        if row.get("protocol") == _STRONGER and row["success"] and _scene(row) in lost
        else row
        for row in rows
    ]


def _scene(row: Row) -> tuple[Any, ...]:
    return row["agent"], row["object"], row["trial"]


def protocol_counts(rows: Mapping[str, Sequence[Row]]) -> dict[str, dict[str, Any]]:
    """Return trials, successes, rate and 95 % interval of each protocol, and of those made of them that are whole."""
    found = {name: _pooled([(own, 1.0)]) for name, own in rows.items()}
    groups = {name: names for name, names in GROUPS.items() if all(part in rows for part in names)}
    for name, names in groups.items():
        found[name] = _pooled([(rows[part], 1.0 / len(names)) for part in names])
    if all(name in found for name in ROBUST):
        members = [GROUPS.get(name, (name,)) for name in ROBUST]
        weighted = [(rows[part], 1.0 / (len(ROBUST) * len(own))) for own in members for part in own]
        found["robust"] = _pooled(weighted)
    return found


def _pooled(parts: Sequence[tuple[Sequence[Row], float]]) -> dict[str, Any]:
    """Return the count of parts with the mean of their rates.

    The interval is Wilson's at the number of trials that would give the mean the same variance, were they of one part:
    exact for one part.
    """
    sizes = [len(rows) for rows, _ in parts]
    wins = [sum(bool(row["success"]) for row in rows) for rows, _ in parts]
    rates = [k / n if n else 0.0 for k, n in zip(wins, sizes, strict=True)]
    rate = sum(weight * r for (_, weight), r in zip(parts, rates, strict=True))
    variance = sum(
        weight**2 * r * (1.0 - r) / n for (_, weight), r, n in zip(parts, rates, sizes, strict=True) if n
    )
    total = sum(sizes)
    alike = rate * (1.0 - rate) / variance if variance > 0.0 else float(total)
    trials = max(1, min(total, round(alike))) if total else 0
    interval = wilson_interval(round(rate * trials), trials)
    return {"trials": total, "successes": sum(wins), "rate": rate, "ci95": list(interval)}
