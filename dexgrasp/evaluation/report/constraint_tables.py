"""Tables 4-6: constraints that grasps satisfy, and what planning takes, the paper's figures beside ours."""

from collections.abc import Callable, Mapping, Sequence

from dexgrasp.evaluation.report import paper
from dexgrasp.evaluation.report.tables import Table
from dexgrasp.runs.text import seconds_words
from dexgrasp_env.arrays import Fields

PLANNER = "bilevel"
"""The agent whose times stand beside Table 6, which is of the paper's planner alone."""


def constraint_tables(name: str, agent: Fields) -> list[tuple[str, Table]]:
    """Return titles and tables of one agent's constraints and times; none where the data are not there."""
    constraints = agent["constraints"]
    groups = {**constraints.get("by_set", {}), "overall": constraints} if constraints else {}
    tables = []
    if any("distance_cm" in group for group in groups.values()):
        tables.append((f"Fingertip-object distance, cm, {name} (Table 4)", _distances(groups)))
    if any("force_ratio_percent" in group for group in groups.values()):
        tables.append((f"Force and torque ratio, percent, {name} (Table 5)", _ratios(groups)))
    if agent["planning_seconds"]:
        title = f"Planning time, s, {name}{' (Table 6)' if name == PLANNER else ''}"
        printed = paper.SECONDS if name == PLANNER else {}
        tables.append((title, _times(agent["planning_seconds"], agent["stages"], printed)))
    return tables


def _distances(groups: Fields) -> Table:
    keys = ("median", "min", "max", "max_violation")
    rows = []
    for group, content in groups.items():
        own = content.get("distance_cm")
        printed = ", ".join(f"{value:.2f}" for value in paper.DISTANCES_CM.get(group, ()))
        rows.append([group, *(f"{own[key]:.2f}" if own else "-" for key in keys), printed])
    return Table(("set", "median", "min.", "max.", "max. violation", "paper"), rows)


def _ratios(groups: Fields) -> Table:
    rows = []
    for group, content in groups.items():
        printed = paper.RATIOS.get(group, {})
        pairs = [(content.get(f"{kind}_ratio_percent"), printed.get(kind)) for kind in ("force", "torque")]
        rows.append(
            [group, *(cell for ours, theirs in pairs for cell in (_quartiles(ours), _spread(theirs)))]
        )
    return Table(("set", "force ratio", "paper", "torque ratio", "paper"), rows)


def _times(
    total: Mapping[str, float],
    stages: Fields,
    printed: Mapping[str, Mapping[str, Sequence[float]]],
) -> Table:
    whole = printed.get("overall", {}).get("total")
    rows = [["total, overall", _quartiles(total, seconds_words), "", _spread(whole, seconds_words)]]
    for group in paper.SECONDS:
        own = stages.get(group, {})
        for stage, seconds in own.get("stage_seconds", {}).items():
            repeats, theirs = own.get("stage_repeats", {}).get(stage), printed.get(group, {}).get(stage)
            cells = [_quartiles(seconds, seconds_words), _quartiles(repeats), _spread(theirs, seconds_words)]
            rows.append([f"{stage}, {group}", *cells])
    return Table(("stage, set", "seconds", "repeats", "paper, seconds"), rows)


def _quartiles(values: Mapping[str, float] | None, words: Callable[[float], str] = "{:.2f}".format) -> str:
    return _spread([values[key] for key in ("median", "p25", "p75")], words) if values else "-"


def _spread(values: Sequence[float] | None, words: Callable[[float], str] = "{:.2f}".format) -> str:
    """Return median and quartiles as people read them; "" for None."""
    return "{} ({}, {})".format(*map(words, values)) if values else ""
