"""Tables 4-6: constraints that grasps satisfy, and what planning takes, the paper's figures beside ours."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dexgrasp.evaluation.report import paper
from dexgrasp.evaluation.report.tables import T, Table
from dexgrasp.runs.text import seconds_words

_PLANNER = "bilevel"  # Table 6 is of the paper's planner alone
Words = Callable[[float], str]
_TWO_DECIMALS: Words = "{:.2f}".format
_GROUPS = ("seen", "familiar", "novel", "overall")


def constraint_tables(name: str, agent: Mapping[str, Any], table: Table[T]) -> list[tuple[str, T]]:
    """Return titles and tables of one agent's constraints and times; none where the data are not there."""
    parts = []
    constraints = agent.get("constraints") or {}
    groups = {**constraints.get("by_set", {}), "overall": constraints} if constraints else {}
    if any("distance_cm" in group for group in groups.values()):
        parts.append((f"Fingertip-object distance, cm, {name} (Table 4)", _distances(groups, table)))
    if any("force_ratio_percent" in group for group in groups.values()):
        parts.append((f"Force and torque ratio, percent, {name} (Table 5)", _ratios(groups, table)))
    stages = agent.get("stages") or {}
    if agent.get("planning_seconds"):
        table_6 = " (Table 6)" if name == _PLANNER else ""
        times = _times(name, agent["planning_seconds"], stages, table)
        parts.append((f"Planning time, s, {name}{table_6}", times))
    return parts


def _distances(groups: Mapping[str, Any], table: Table[T]) -> T:
    keys = ("median", "min", "max", "max_violation")
    rows = []
    for group, content in groups.items():
        own = content.get("distance_cm")
        printed = paper.DISTANCES_CM.get(group)
        rows.append([group, *(f"{own[key]:.2f}" if own else "-" for key in keys), _numbers(printed)])
    return table(["set", "median", "min.", "max.", "max. violation", "paper"], rows)


def _ratios(groups: Mapping[str, Any], table: Table[T]) -> T:
    rows = []
    for group, content in groups.items():
        printed = paper.RATIOS.get(group, {})
        cells = []
        for kind in ("force", "torque"):
            cells += [_quartiles(content.get(f"{kind}_ratio_percent")), _spread(printed.get(kind))]
        rows.append([group, *cells])
    return table(["set", "force ratio", "paper", "torque ratio", "paper"], rows)


def _times(name: str, total: Mapping[str, float], stages: Mapping[str, Any], table: Table[T]) -> T:
    printed_of = paper.SECONDS if name == _PLANNER else {}
    rows = [
        [
            "total, overall",
            _quartiles(total, seconds_words),
            "",
            _spread(printed_of.get("overall", {}).get("total")),
        ]
    ]
    for group in (g for g in _GROUPS if g in stages):
        seconds, repeats = stages[group].get("stage_seconds", {}), stages[group].get("stage_repeats", {})
        for stage in seconds:
            printed = printed_of.get(group, {}).get(stage)
            rows.append(
                [
                    f"{stage}, {group}",
                    _quartiles(seconds[stage], seconds_words),
                    _quartiles(repeats.get(stage)),
                    _spread(printed),
                ]
            )
    return table(["stage, set", "seconds", "repeats", "paper, seconds"], rows)


def _quartiles(values: Mapping[str, float] | None, words: Words = _TWO_DECIMALS) -> str:
    return _spread((values["median"], values["p25"], values["p75"]), words) if values else "-"


def _spread(values: Sequence[float] | None, words: Words = _TWO_DECIMALS) -> str:
    return "{} ({}, {})".format(*map(words, values)) if values else ""


def _numbers(values: Sequence[float] | None) -> str:
    return ", ".join(f"{value:.2f}" for value in values) if values else ""
