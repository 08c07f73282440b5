"""Summary of an evaluation; docs/evaluation.md documents its schema 1."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from dexgrasp.evaluation.protocol import GROUPS, OTHER_PHYSICS
from dexgrasp.evaluation.settings import EvaluationSettings, versions
from dexgrasp.evaluation.statistics import (
    Counts,
    cluster_interval,
    object_interval,
    quantiles,
)
from dexgrasp.evaluation.store import Trials, row_key
from dexgrasp_env.arrays import Fields
from dexgrasp_env.objects.catalogue import CATALOGUE, OBJECT_SETS

_FIGURES = (
    "force_ratio_percent",
    "torque_ratio_percent",
    "closure_margin",
    "min_clearance_m",
    "joint_limit_margin_rad",
    "max_joint_torque_fraction",
)
"""Numbers of a certificate, beside its distances."""
_QUARTILES = {"median": 0.5, "p25": 0.25, "p75": 0.75}


def summarise(settings: EvaluationSettings, rows: Trials) -> Fields:
    """Return the summary of finished trials; `complete` is true if no trial is missing.

    Args:
        settings: of the evaluation.
        rows: finished trials.
    """
    rows = judged(rows)
    place = {name: k for k, name in enumerate(settings.parts)}
    ordered = sorted(rows, key=lambda row: (place.get(row["protocol"], 0), row["object"], row["trial"]))
    by_agent = grouped(ordered, "agent")
    asked = len(settings.agents) * len(settings.objects) * len(settings.parts) * settings.trials
    return {
        "schema": 1,
        "protocol": settings.protocol,
        "seed": settings.seed,
        "versions": versions(),
        "complete": len(rows) == asked,
        "agents": {agent: summarise_agent(by_agent.get(agent, [])) for agent in settings.agents},
    }


def judged(rows: Trials) -> list[Fields]:
    """Return the trials, those of `pushed@1` failed where the same scene failed under `pushed@0.5`."""
    lost = {row_key(row)[1:] for row in rows if row["protocol"] == "pushed@0.5" and not row["success"]}
    return [
        {**row, "success": False, "reason": "failed_pushed@0.5"}
        if row["protocol"] == "pushed@1" and row["success"] and row_key(row)[1:] in lost
        else row
        for row in rows
    ]


def scene_key(row: Fields) -> tuple[Any, ...]:
    """Return the key of a trial's scene, which trials under other protocols share."""
    return row["object"], row["trial"], row.get("scene_seed")


def summarise_agent(rows: Trials) -> Fields:
    """Return one agent's part of the summary; trials in another engine than MuJoCo count in `by_protocol` only."""
    by_protocol = grouped(rows, "protocol")
    rows = [row for row in rows if row["protocol"] != OTHER_PHYSICS] or rows
    by_object = grouped(rows, "object")
    sets = {
        name: [row for row in rows if row["object"] in own]
        for name, own in present_sets(list(by_object)).items()
    }
    constraints = {name: own for name, of in sets.items() if (own := _constraints(of))}
    return {
        **count(rows),
        "by_set": {name: count(own) for name, own in sets.items()},
        "by_object": {name: bare_count(own) for name, own in by_object.items()},
        "by_protocol": protocol_counts(by_protocol),
        "failures": dict(Counter(row["reason"] for row in rows if not row["success"]).most_common()),
        "planning_seconds": quantiles(_known(rows, "planning_seconds"), **_QUARTILES, p90=0.9),
        "mean_return": _mean(rows, "total_reward"),
        "mean_length": _mean(rows, "steps"),
        "stable": sum(row["stable"] and row["success"] for row in rows),
        "constraints": _constraints(rows) | ({"by_set": constraints} if constraints else {}),
        "clutter": {name: found for name, own in by_protocol.items() if (found := _neighbours(own))},
        "stages": {name: found for name, own in {"overall": rows, **sets}.items() if (found := _stages(own))},
    }


def grouped(rows: Trials, key: str) -> dict[Any, list[Fields]]:
    """Group trials by the value of a key, in order of appearance; None for those without the key."""
    found: dict[Any, list[Fields]] = {}
    for row in rows:
        found.setdefault(row.get(key), []).append(row)
    return found


def _neighbours(rows: Trials) -> Fields:
    """Return counts of clean lifts and of trials that hit a neighbour; {} without neighbours."""
    among = [row for row in rows if row.get("clean") is not None]
    if not among:
        return {}
    return {
        "clean": count([{**row, "success": row["clean"]} for row in among]),
        "hit": count([{**row, "success": row["hit"] > 0} for row in among]),
        "moved": quantiles(_known(among, "moved"), **_QUARTILES, max=1.0),
        "hit_objects": dict(Counter(name for row in among for name in row["hit_names"]).most_common()),
    }


def _known(contents: Trials, key: str) -> list[float]:
    return [content[key] for content in contents if content.get(key) is not None]


def _mean(rows: Trials, key: str) -> float | None:
    values = _known(rows, key)
    return sum(values) / len(values) if values else None


def object_counts(rows: Trials) -> Counts:
    """Return object -> (successes, trials)."""
    return {
        name: (sum(row["success"] for row in own), len(own)) for name, own in grouped(rows, "object").items()
    }


def protocol_counts(rows: Mapping[str, Trials]) -> dict[str, Fields]:
    """Return trials, successes, rate and 95 % interval of each protocol, and of each group that is complete."""
    weights = {name: {name: 1.0} for name in rows}
    for group, names in GROUPS.items():
        own = [weights.get(name, {name: 1.0}) for name in names]
        weights[group] = {part: w / len(names) for each in own for part, w in each.items()}
    return {
        name: pooled((rows[part], weight) for part, weight in own.items())
        for name, own in weights.items()
        if own.keys() <= rows.keys()
    }


def pooled(parts: Iterable[tuple[Trials, float]]) -> Fields:
    """Return trials, successes, rate and 95 % interval of weighted groups of trials, which may share scenes."""
    total, wins, rate = 0, 0, 0.0
    moved = list[tuple[Any, float]]()
    for rows, weight in parts:
        n, k = len(rows), sum(bool(row["success"]) for row in rows)
        own = k / n if n else 0.0
        total, wins = total + n, wins + k
        rate += weight * own
        moved += [(scene_key(row), weight / n * (bool(row["success"]) - own)) for row in rows]
    ends = list(cluster_interval(rate, moved, total))
    return {"trials": total, "successes": wins, "rate": rate, "ci95": ends}


def count(rows: Trials) -> Fields:
    """Return trials, successes, rate and its 95 % intervals by scenes and by objects."""
    return {**pooled([(rows, 1.0)]), "ci95_objects": list(object_interval(object_counts(rows)))}


def bare_count(rows: Trials) -> dict[str, int]:
    """Return trials and successes."""
    return {"trials": len(rows), "successes": sum(row["success"] for row in rows)}


def present_sets(objects: Sequence[str]) -> dict[str, list[str]]:
    """Return the sets that have members among `objects`, with these members.

    The training set counts only if it has members here that are not seen test objects.
    """
    names = ("seen", "familiar", "novel", "ycb6")
    sets = {name: [o for o in objects if o in OBJECT_SETS[name]] for name in names}
    if set(sets["ycb6"]) <= set(sets["seen"]):
        sets["ycb6"] = []
    sets["meshes"] = [o for o in objects if o not in CATALOGUE]
    return {name: members for name, members in sets.items() if members}


def _constraints(rows: Trials) -> Fields:
    """Return the distributions of the certificates' figures (Tables 4 and 5); {} without certificates."""
    certificates = [own for row in rows if (own := row["details"].get("certificate"))]
    if not certificates:
        return {}
    columns = {
        "distance_cm": [d for own in certificates for d in own.get("distances_cm") or [] if d is not None],
        **{key: _known(certificates, key) for key in _FIGURES},
    }
    spreads = {key: quantiles(own, **_QUARTILES, min=0.0, max=1.0) for key, own in columns.items() if own}
    if spread := spreads.get("distance_cm"):
        low, high = -0.68, -0.32  # supplementary, section 1.2
        spreads["distance_cm"] = {key: spread[key] for key in ("median", "min", "max")} | {
            "max_violation": max(0.0, low - spread["min"], spread["max"] - high)
        }
    return {
        "grasps": len(certificates),
        "hold": sum(bool(own.get("holds")) for own in certificates),
        **spreads,
    }


def _stages(rows: Trials) -> Fields:
    """Return quartiles of the times and repeats of planning stages, as the agent reports them (Table 6)."""
    found = {}
    for key in ("stage_seconds", "stage_repeats"):
        reports = [row["details"].get(key) or {} for row in rows]
        names = dict.fromkeys(name for report in reports for name in report)
        if names:
            found[key] = {name: quantiles(_known(reports, name), **_QUARTILES) for name in names}
    return found
