"""The plots that a report shows, by the part of it that shows them."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from dexgrasp.evaluation.prediction import PREDICTORS, Prediction
from dexgrasp.evaluation.report import paper
from dexgrasp.evaluation.report.constraint_tables import PLANNER
from dexgrasp.evaluation.report.plots import Counts, Figure, plot_curves, plot_rates, plot_stages
from dexgrasp.evaluation.report.tables import SETS, Agents, ordered_objects

CURVES: dict[str, tuple[str, tuple[tuple[float, str], ...]]] = {
    "friction": ("friction coefficient", ((0.35, "slippery@0.35"), (0.5, "slippery@0.5"), (0.7, "lift"))),
    "mass": ("mass, of the object's own", ((1.0, "lift"), (1.5, "heavy"))),
    "push": ("push at friction 0.5, of the weight", ((0.0, "slippery@0.5"), (0.5, "pushed@0.5"), (1.0, "pushed@1"))),
}  # fmt: skip
"""What is varied -> what the axis says, and (value, protocol) of each point."""


def success_by_set(agents: Agents) -> Figure:
    """Return success over all objects and by set, the paper's beside ours."""
    sets = [name for name in SETS if any(name in a["by_set"] for a in agents.values())]
    ours = {name: _counts({**agent["by_set"], "all": agent}) for name, agent in agents.items()}
    printed = {name: paper.set_successes(name) for name in agents}
    return Figure(
        "success_by_set", "Success by set of objects", partial(plot_rates, ["all", *sets], ours, printed)
    )


def success_by_object(agents: Agents) -> Figure:
    """Return success by object, the paper's beside ours."""
    ours = {name: _counts(agent["by_object"]) for name, agent in agents.items()}
    draw = partial(plot_rates, ordered_objects(agents), ours, paper.SUCCESSES)
    return Figure("success_by_object", "Success by object", draw)


def success_by_protocol(agents: Agents, protocols: Sequence[str]) -> Figure:
    """Return success by protocol."""
    ours = {name: _counts(agent["by_protocol"]) for name, agent in agents.items()}
    return Figure("success_by_protocol", "Success by protocol", partial(plot_rates, protocols, ours, {}))


def success_by_hardness(agents: Agents) -> list[Figure]:
    """Return a figure for each quantity that at least two protocols of the evaluation vary."""
    figures = []
    for name, (label, points) in CURVES.items():
        if sum(any(part in a["by_protocol"] for a in agents.values()) for _, part in points) > 1:
            series = {}
            for agent, content in agents.items():
                counts = _counts(content["by_protocol"])
                series[agent] = [(value, counts[part]) for value, part in points if part in counts]
            draw = partial(plot_curves, series, label, 3.4)
            figures.append(Figure(f"success_by_{name}", f"Success against {label}", draw))
    return figures


def reliability(found: Mapping[str, Mapping[str, Prediction]]) -> list[Figure]:
    """Return success against what certificates claim: agent -> predictor -> what it says of trials."""
    figures = []
    for name in ("load", "closure_margin"):
        series = {
            agent: [(b.median, (b.successes, b.trials)) for b in own[name].bins]
            for agent, own in found.items()
            if name in own
        }
        if series:
            draw = partial(plot_curves, series, f"{PREDICTORS[name]} (median of each part)", 3.2)
            caption = f"Success against {PREDICTORS[name]}, in equal parts"
            figures.append(Figure(f"reliability_{name}", caption, draw))
    return figures


def planning_times(agents: Agents) -> list[Figure]:
    """Return planning times by stage, where an agent reports any."""
    staged = {}
    for name, agent in agents.items():
        if agent["planning_seconds"]:
            stages = agent["stages"].get("overall", {}).get("stage_seconds", {})
            spreads = {**stages, "total": agent["planning_seconds"]}
            staged[name] = {stage: (s["median"], s["p25"], s["p75"]) for stage, s in spreads.items()}
    printed = paper.SECONDS["overall"] if PLANNER in staged else {}
    caption = "Planning time by stage; the paper's is of its planner"
    return [Figure("planning_times", caption, partial(plot_stages, staged, printed))] if staged else []


def _counts(cells: Mapping[str, Mapping[str, Any]]) -> dict[str, Counts]:
    return {name: (cell["successes"], cell["trials"]) for name, cell in cells.items()}
