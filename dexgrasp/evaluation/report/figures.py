"""The plots that a report shows, by the part of it that shows them."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from dexgrasp.evaluation.report import paper
from dexgrasp.evaluation.report.plots import SUCCESS, Figure, Points
from dexgrasp.evaluation.report.tables import PLANNER, Agents
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp_env.arrays import Fields


def success(key: str, words: str, agents: Agents, rows: Sequence[str]) -> Figure:
    """Return success rates by what `key` of the summary counts, a row for each name, the paper's beside ours."""
    ours = {name: _rates({**agent[key], "all": agent}, rows) for name, agent in agents.items()}
    printed = {name: _rates(paper.successes(name), rows) for name in agents}
    shown = {row: row.replace("_", " ") for row in rows}
    return Figure(f"success_{key}", f"Success by {words}", SUCCESS, ours, printed, shown)


def planning_times(agents: Agents) -> list[Figure]:
    """Return planning times by stage on a logarithmic axis, where an agent reports any."""
    shown = {}
    # Stages as Table 6 has them -> what they are here.
    names = {
        "cvae": "proposals (CVAE)",
        "ik": "postures (IK)",
        "bilevel": "bilevel, certificate",
        "total": "total",
    }
    for name, agent in agents.items():
        if total := agent["planning_seconds"]:
            stages = agent["stages"].get("overall", {}).get("stage_seconds", {}) | {"total": total}
            shown[name] = {  # 1e-4 s stands for nothing on a logarithmic axis
                stage: [max(times[key], 1e-4) for key in ("median", "p25", "p75")]
                for stage, times in stages.items()
                if stage in names
            }
    rows = {stage: words for stage, words in names.items() if any(stage in own for own in shown.values())}
    caption = "Planning time by stage; the paper's is of its planner"
    label, printed = (
        "seconds: median, 25th and 75th percentile",
        {PLANNER: paper.PRINTED["seconds"]["overall"]},
    )
    return [Figure("planning_times", caption, label, shown, printed, rows, log=True)] if shown else []


def _rates(cells: Mapping[Any, Fields], keys: Iterable[Any]) -> Points:
    """Return success rates with the ends of the tables' intervals, percent; Wilson's of cells that are counts alone."""
    rates = {}
    for key in keys:
        if key in cells and (n := cells[key]["trials"]):
            k = cells[key]["successes"]
            cell = {"rate": k / n, "ci95": wilson_interval(k, n)} | cells[key]
            rates[key] = [100.0 * value for value in (cell["rate"], *cell["ci95"])]
    return rates
