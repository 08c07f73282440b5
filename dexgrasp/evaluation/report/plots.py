"""Plots of a report: success with intervals, the paper's figures beside ours; planning times by stage."""

import io
from collections.abc import Mapping, Sequence
from typing import Any

from dexgrasp.evaluation.statistics import wilson_interval

Counts = Mapping[str, Mapping[str, int]]
"""Row -> {"trials", "successes"}."""
Printed = Mapping[str, tuple[int, int]]
"""Row -> the paper's (successes, trials)."""

_ROW, _WIDTH = 0.34, 8.2  # inches
_PAPER_STAGE = {
    "cvae": "proposals (CVAE)",
    "ik": "postures (IK)",
    "bilevel": "bilevel, certificate",
    "total": "total",
}
"""Stages as Table 6 has them -> what they are here."""


def plot_rates(
    names: Sequence[str], ours: Mapping[str, Counts], printed: Mapping[str, Printed], kind: str
) -> bytes:
    """Draw success rates with Wilson intervals, a row for each name, a colour for each agent.

    Args:
        names: rows from the top.
        ours: agent -> counts.
        printed: agent -> the paper's counts, drawn as hollow diamonds in the agent's colour.
        kind: "svg" or "png".
    """
    figure, axes = new_figure(max(2.0, 0.9 + _ROW * len(names) * (0.55 + 0.45 * len(ours))))
    step = 0.7 / len(ours)
    for i, (agent, own) in enumerate(ours.items()):
        offset = (i - 0.5 * (len(ours) - 1)) * step
        _draw_agent(axes, agent, f"C{i}", own, names, offset)
        marks = [(y, printed[agent][n]) for y, n in enumerate(names) if n in printed.get(agent, {})]
        if marks:
            axes.plot(
                [100.0 * k / n for _, (k, n) in marks], [y + offset for y, _ in marks], "D", color=f"C{i}", mfc="none",
                ms=6.5, label=f"{agent}, paper (real robot)", zorder=3,
            )  # fmt: skip
    axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    axes.set(xlim=(-2, 102), ylim=(len(names) - 0.45, -0.55), xlabel="success, % (95 % interval)")
    return finished(figure, axes, kind)


def plot_stages(
    agents: Mapping[str, Mapping[str, Any]], printed: Mapping[str, Sequence[float]], kind: str
) -> bytes:
    """Draw planning times by stage: median and quartiles on a logarithmic axis.

    Args:
        agents: agent -> stage -> {"median", "p25", "p75"}, s.
        printed: stage -> the paper's median and quartiles, s.
        kind: "svg" or "png".
    """
    stages = [s for s in _PAPER_STAGE if any(s in own for own in agents.values())]
    figure, axes = new_figure(1.1 + _ROW * len(stages) * (1 + 0.5 * len(agents)))
    series = [(name, f"C{i}", own) for i, (name, own) in enumerate(agents.items())]
    spreads = {s: {"median": v[0], "p25": v[1], "p75": v[2]} for s, v in printed.items()}
    series += [("paper", "0.35", spreads)] if spreads else []
    for i, (name, colour, own) in enumerate(series):
        shown = [(y + (i - 0.5 * (len(series) - 1)) * 0.22, own[s]) for y, s in enumerate(stages) if s in own]
        middle = [max(cell["median"], 1e-4) for _, cell in shown]
        ends = [
            [m - min(max(c["p25"], 1e-4), m) for m, (_, c) in zip(middle, shown, strict=True)],
            [max(c["p75"] - m, 0.0) for m, (_, c) in zip(middle, shown, strict=True)],
        ]
        axes.errorbar(
            middle, [y for y, _ in shown], xerr=ends, fmt="o", color=colour, ms=5, capsize=3, label=name
        )
    axes.set_yticks(range(len(stages)), [_PAPER_STAGE[s] for s in stages])
    axes.set(
        xscale="log", ylim=(len(stages) - 0.45, -0.55), xlabel="seconds: median, 25th and 75th percentile"
    )
    return finished(figure, axes, kind)


def _draw_agent(axes: Any, agent: str, colour: str, own: Counts, names: Sequence[str], offset: float) -> None:
    shown = [(y + offset, own[name]) for y, name in enumerate(names) if own.get(name, {}).get("trials")]
    rates = [100.0 * c["successes"] / c["trials"] for _, c in shown]
    ends = [[100.0 * e for e in wilson_interval(c["successes"], c["trials"])] for _, c in shown]
    errors = [
        [max(r - low, 0.0) for r, (low, _) in zip(rates, ends, strict=True)],
        [max(high - r, 0.0) for r, (_, high) in zip(rates, ends, strict=True)],
    ]
    places = [y for y, _ in shown]
    axes.errorbar(rates, places, xerr=errors, fmt="o", color=colour, ms=4.5, capsize=2, lw=1.3, label=agent)


def new_figure(height: float) -> tuple[Any, Any]:
    """Return a figure of the report's width and its axes; `height` in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH, height), layout="constrained")
    return figure, figure.add_subplot()


def finished(figure: Any, axes: Any, kind: str) -> bytes:
    """Return a figure with grid and legend as "svg" or "png", the same bytes for the same content."""
    from matplotlib import rc_context

    axes.grid(axis="x", color="0.9", lw=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    entries = sorted(zip(*axes.get_legend_handles_labels(), strict=True), key=lambda pair: str(pair[1]))
    handles, labels = zip(*entries, strict=True)
    figure.legend(handles, labels, fontsize="small", loc="outside upper left", ncols=2, frameon=False)
    buffer = io.BytesIO()
    # Dates and random ids would make two reports of the same trials differ.
    metadata = {"Date": None} if kind == "svg" else None
    with rc_context({"svg.hashsalt": "dexgrasp"}):
        figure.savefig(buffer, format=kind, dpi=130, metadata=metadata)
    return buffer.getvalue()
