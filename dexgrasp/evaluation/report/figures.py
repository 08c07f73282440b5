"""Plots of a report: rates or medians as points with interval bars, the paper's as hollow diamonds."""

import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from dexgrasp.evaluation.report import paper
from dexgrasp.evaluation.report.tables import PLANNER, Agents
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp_env.arrays import Fields

Points = Mapping[str, Sequence[float]]
"""Row -> middle, low and high."""

SUCCESS = "success, % (95 % interval)"


class IntervalPlot(NamedTuple):
    """Plot of intervals.

    Attributes:
        name: its file's stem.
        caption: what it shows.
        label: what the horizontal axis says.
        agents: agent -> its points; a colour for each agent.
        printed: agent -> the paper's points, of which only the middle is drawn.
        rows: names of the rows from the top, as points call them -> as people read them.
        log: flag: the horizontal axis is logarithmic; otherwise points are percentages.
    """

    name: str
    caption: str
    label: str
    agents: Mapping[str, Points]
    printed: Mapping[str, Points]
    rows: Mapping[str, str]
    log: bool = False

    def draw(self, kind: str) -> bytes:
        """Return the plot as "svg" or "png", the same bytes for the same content."""
        from matplotlib.figure import Figure

        rows = self.rows
        height = 1.0 + 0.34 * len(rows) * (0.55 + 0.45 * len(self.agents))  # inches
        figure = Figure(figsize=(8.2, max(2.0, height)), layout="constrained")
        style = {"fmt": "o", "ms": 5, "capsize": 3, "lw": 1.3}
        hollow = {"fmt": "D", "mfc": "none", "ms": 6.5, "zorder": 3}
        axes = figure.add_subplot()
        for k, (agent, points) in enumerate(self.agents.items()):
            self._add(axes, k, agent, points, style)
            printed = {
                key: [value[0]] * 3 for key, value in self.printed.get(agent, {}).items() if key in rows
            }
            if printed:
                self._add(axes, k, f"{agent}, paper", printed, hollow)
        axes.set(xlabel=self.label, xscale="log" if self.log else "linear")
        if not self.log:
            axes.set(xlim=(-2, 102))
        axes.grid(axis="x", color="0.9", lw=0.8)
        axes.set_yticks(range(len(rows)), rows.values())
        axes.set_ylim(len(rows) - 0.45, -0.55)
        return _finished(figure, axes, kind)

    def _add(self, axes: Any, k: int, label: str, points: Points, style: Fields) -> None:
        # The points of all agents share 0.7 of a row.
        offset = (k - 0.5 * (len(self.agents) - 1)) * 0.7 / len(self.agents)
        places = {name: y + offset for y, name in enumerate(self.rows)}
        at = [places[key] for key in points]
        middle, low, high = np.array(list(points.values())).reshape(-1, 3).T
        ends = np.maximum([middle - low, high - middle], 0.0)
        axes.errorbar(middle, at, xerr=ends, **style, color=f"C{k}", label=label)


def _finished(figure: Any, axes: Any, kind: str) -> bytes:
    from matplotlib import rc_context

    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    entries = sorted(zip(*axes.get_legend_handles_labels(), strict=True), key=lambda pair: str(pair[1]))
    handles, labels = zip(*entries, strict=True)
    figure.legend(handles, labels, fontsize="small", loc="outside upper left", ncols=2, frameon=False)
    buffer = io.BytesIO()
    # Dates and random ids would make two reports of the same trials differ.
    with rc_context({"svg.hashsalt": "dexgrasp"}):
        figure.savefig(buffer, format=kind, dpi=130, metadata={"Date": None} if kind == "svg" else None)
    return buffer.getvalue()


def success(key: str, words: str, agents: Agents, rows: Sequence[str]) -> IntervalPlot:
    """Return the plot of success rates of one breakdown (`by_set`, `by_object`, ...), the paper's beside ours."""
    ours = {name: _rates({**agent[key], "all": agent}, rows) for name, agent in agents.items()}
    printed = {name: _rates(paper.successes(name), rows) for name in agents}
    shown = {row: row.replace("_", " ") for row in rows}
    return IntervalPlot(f"success_{key}", f"Success by {words}", SUCCESS, ours, printed, shown)


def planning_times(agents: Agents) -> list[IntervalPlot]:
    """Return the plot of planning times by stage, if an agent reports any."""
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
    return [IntervalPlot("planning_times", caption, label, shown, printed, rows, log=True)] if shown else []


def _rates(cells: Mapping[Any, Fields], keys: Iterable[Any]) -> Points:
    """Return success rates and intervals, percent; Wilson's interval for cells that have counts only."""
    rates = {}
    for key in keys:
        if key in cells and (n := cells[key]["trials"]):
            k = cells[key]["successes"]
            cell = {"rate": k / n, "ci95": wilson_interval(k, n)} | cells[key]
            rates[key] = [100.0 * value for value in (cell["rate"], *cell["ci95"])]
    return rates
