"""The summary of an evaluation, as documented in docs: schema 1."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import Any

from dexgrasp.evaluation.protocol_counts import judged, protocol_counts
from dexgrasp.evaluation.settings import EvaluationSettings, versions
from dexgrasp.evaluation.statistics import (
    Counts,
    mcnemar,
    object_interval,
    quantiles,
    success_within,
    wilson_interval,
)
from dexgrasp_env.objects.catalogue import CATALOGUE, OBJECT_SETS

Row = Mapping[str, Any]
SCHEMA = 1
_TRIES = (1, 2, 3)  # success within so many tries, each a fresh scene and a fresh plan
TEST_SETS = ("seen", "familiar", "novel")
DISTANCE_BOUNDS_CM = (-0.68, -0.32)  # supplementary, section 1.2
_RATIOS = ("force_ratio_percent", "torque_ratio_percent")
_MARGINS = ("closure_margin", "min_clearance_m", "joint_limit_margin_rad", "max_joint_torque_fraction")
_QUARTILES = {"median": 0.5, "p25": 0.25, "p75": 0.75}


def summarise(
    settings: EvaluationSettings,
    rows: Sequence[Row],
    *,
    stopped_after: int | None = None,
    stop_level: float | None = None,
) -> dict[str, Any]:
    """Return the summary of the trials that are there; `complete` says whether these are all.

    Args:
        settings: of the evaluation.
        rows: finished trials.
        stopped_after: trials a cell after which it was decided; later ones, begun before that was known, do not count.
        stop_level: of the sequential test; None where there was none.
    """
    if stopped_after is not None:
        rows = [row for row in rows if row["trial"] < stopped_after]
    rows = judged(rows)
    ordered = sorted(rows, key=lambda row: (settings.agents.index(row["agent"]), row["object"], row["trial"]))
    by_agent = {agent: [row for row in ordered if row["agent"] == agent] for agent in settings.agents}
    return {
        "schema": SCHEMA,
        "protocol": settings.protocol,
        "seed": settings.seed,
        "versions": versions(),
        "complete": stopped_after is not None
        or len(rows) == len(settings.agents) * len(settings.objects) * len(settings.parts) * settings.trials,
        **(
            {}
            if stop_level is None
            else {"sequential": {"level": stop_level, "stopped_after": stopped_after}}
        ),
        "agents": {agent: summarise_agent(own) for agent, own in by_agent.items()},
        "paired": [compare(a, by_agent[a], b, by_agent[b]) for a, b in combinations(settings.agents, 2)],
    }


def summarise_agent(rows: Sequence[Row]) -> dict[str, Any]:
    """Return one agent's part of the summary."""
    objects = list(dict.fromkeys(row["object"] for row in rows))
    members = {
        name: [row for row in rows if row["object"] in names] for name, names in present_sets(objects).items()
    }
    times = [row["planning_seconds"] for row in rows if row["planning_seconds"] is not None]
    counts = object_counts(rows)
    return {
        **count(rows),
        "ci95_objects": list(object_interval(counts)),
        "within_tries": {str(k): p for k in _TRIES if (p := success_within(counts, k)) is not None},
        "by_set": {
            name: {**count(own), "ci95_objects": list(object_interval(object_counts(own)))}
            for name, own in members.items()
        },
        "by_object": {name: _bare_count([row for row in rows if row["object"] == name]) for name in objects},
        "by_protocol": protocol_counts(by_protocol(rows)),
        "failures": dict(Counter(row["reason"] for row in rows if not row["success"]).most_common()),
        "planning_seconds": quantiles(times, **_QUARTILES, p90=0.9),
        "mean_return": _mean(rows, "total_reward"),
        "mean_length": _mean(rows, "steps"),
        "stable": sum(row["stable"] and row["success"] for row in rows),
        "constraints": summarise_constraints(rows, members),
        "stages": summarise_stages(rows, members),
    }


def _mean(rows: Sequence[Row], name: str) -> float | None:
    values = [float(row[name]) for row in rows if row.get(name) is not None]
    return sum(values) / len(values) if values else None


def object_counts(rows: Sequence[Row]) -> Counts:
    """Return object -> (successes, trials)."""
    counts: dict[str, tuple[int, int]] = {}
    for row in rows:
        k, n = counts.get(row["object"], (0, 0))
        counts[row["object"]] = k + bool(row["success"]), n + 1
    return counts


def by_protocol(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the trials of each protocol; those of 0.1.0 name none."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        if row.get("protocol"):
            found.setdefault(row["protocol"], []).append(row)
    return found


def count(rows: Sequence[Row]) -> dict[str, Any]:
    """Return trials, successes, rate and its 95 % interval."""
    bare = _bare_count(rows)
    n, k = bare["trials"], bare["successes"]
    return {**bare, "rate": k / n if n else 0.0, "ci95": list(wilson_interval(k, n))}


def _bare_count(rows: Sequence[Row]) -> dict[str, int]:
    return {"trials": len(rows), "successes": sum(row["success"] for row in rows)}


def present_sets(objects: Sequence[str]) -> dict[str, list[str]]:
    """Return the sets that have members among `objects`, with these.

    The training set counts only if more of it is there than what the seen test objects share with it.
    """
    sets = {name: [o for o in objects if o in OBJECT_SETS[name]] for name in (*TEST_SETS, "ycb6")}
    if set(sets["ycb6"]) <= set(sets["seen"]):
        sets["ycb6"] = []
    sets["meshes"] = [o for o in objects if o not in CATALOGUE]
    return {name: members for name, members in sets.items() if members}


def compare(a: str, rows_a: Sequence[Row], b: str, rows_b: Sequence[Row]) -> dict[str, Any]:
    """Compare two agents scene by scene."""

    def scenes(rows: Sequence[Row]) -> dict[object, bool]:
        return {(row.get("protocol"), row["object"], row["trial"]): row["success"] for row in rows}

    return {"a": a, "b": b, **mcnemar(scenes(rows_a), scenes(rows_b))}


def summarise_constraints(rows: Sequence[Row], members: Mapping[str, Sequence[Row]]) -> dict[str, Any]:
    """Return what the grasps' certificates say, over all and by set (Tables 4 and 5); {} without certificates."""
    if not _certificates(rows):
        return {}
    groups = {name: _constraints(_certificates(own)) for name, own in members.items() if _certificates(own)}
    return {**_constraints(_certificates(rows)), "by_set": groups}


def _certificates(rows: Sequence[Row]) -> list[Mapping[str, Any]]:
    found = (row["details"].get("certificate") for row in rows)
    return [certificate for certificate in found if certificate]


def _constraints(certificates: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    distances = [d for c in certificates for d in c.get("distances_cm") or [] if d is not None]
    content: dict[str, Any] = {
        "grasps": len(certificates),
        "hold": sum(bool(c.get("holds")) for c in certificates),
    }
    if distances:
        low, high = DISTANCE_BOUNDS_CM
        violation = max(0.0, low - min(distances), max(distances) - high)
        spread = quantiles(distances, median=0.5) | {"min": min(distances), "max": max(distances)}
        content["distance_cm"] = spread | {"max_violation": violation}
    for key in (*_RATIOS, *_MARGINS):
        values = [c[key] for c in certificates if c.get(key) is not None]
        if values:
            content[key] = quantiles(values, **_QUARTILES) | {"min": min(values), "max": max(values)}
    return content


def summarise_stages(rows: Sequence[Row], members: Mapping[str, Sequence[Row]]) -> dict[str, Any]:
    """Return times and repeats of the stages (Table 6): `stage_seconds` and `stage_repeats` of reports."""
    groups = {"overall": list(rows), **{name: list(own) for name, own in members.items()}}
    found = {name: _stages(own) for name, own in groups.items()}
    return {name: content for name, content in found.items() if content}


def _stages(rows: Sequence[Row]) -> dict[str, Any]:
    return {
        key: content
        for key in ("stage_seconds", "stage_repeats")
        if (content := _spread(rows, lambda row, key=key: row["details"].get(key) or {}))  # type: ignore[misc]
    }


def _spread(rows: Sequence[Row], read: Callable[[Row], Mapping[str, float]]) -> dict[str, dict[str, float]]:
    stages = dict.fromkeys(stage for row in rows for stage in read(row))
    values = {
        stage: [read(row)[stage] for row in rows if read(row).get(stage) is not None] for stage in stages
    }
    return {stage: quantiles(own, **_QUARTILES) for stage, own in values.items()}
