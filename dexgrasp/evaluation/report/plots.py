"""Plots of a report: success with intervals, the paper's figures beside ours; planning times by stage."""

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp_env.arrays import Array

Counts = tuple[int, int]
"""Successes and trials."""
Spread = Sequence[float]
"""Middle, low and high of an error bar."""

_ROW, _WIDTH = 0.34, 8.2  # inches
_LEAST_SECONDS = 1e-4  # what a logarithmic axis shows of nothing
_STYLE = {"ms": 5, "capsize": 3, "lw": 1.3}
_PAPER_STAGE = {
    "cvae": "proposals (CVAE)",
    "ik": "postures (IK)",
    "bilevel": "bilevel, certificate",
    "total": "total",
}
"""Stages as Table 6 has them -> what they are here."""


class Figure(NamedTuple):
    """A plot: its file's stem, what it shows, and what draws it as "svg" or "png"."""

    name: str
    caption: str
    draw: Callable[[str], bytes]


def plot_rates(
    names: Sequence[str],
    ours: Mapping[str, Mapping[str, Counts]],
    printed: Mapping[str, Mapping[str, Counts]],
    kind: str,
) -> bytes:
    """Draw success rates with Wilson intervals, a row for each name, a colour for each agent.

    Args:
        names: rows from the top.
        ours: agent -> row -> counts; rows without trials stay empty.
        printed: agent -> row -> the paper's counts, drawn as hollow diamonds in the agent's colour.
        kind: "svg" or "png".
    """
    figure, axes = _new_figure(max(2.0, 0.9 + _ROW * len(names) * (0.55 + 0.45 * len(ours))))
    for i, (agent, own) in enumerate(ours.items()):
        offset = (i - 0.5 * (len(ours) - 1)) * 0.7 / len(ours)
        shown = {y + offset: own[name] for y, name in enumerate(names) if own.get(name, (0, 0))[1]}
        rates, ends = _bars(map(_rate, shown.values()))
        axes.errorbar(rates, list(shown), xerr=ends, fmt="o", color=f"C{i}", label=agent, **_STYLE)
        marks = {y + offset: printed[agent][n] for y, n in enumerate(names) if n in printed.get(agent, {})}
        if marks:
            rates, _ = _bars(map(_rate, marks.values()))
            words = f"{agent}, paper (real robot)"
            axes.plot(rates, list(marks), "D", color=f"C{i}", mfc="none", ms=6.5, zorder=3, label=words)
    axes.set_xlim(-2, 102)
    return _of_rows(
        figure, axes, [name.replace("_", " ") for name in names], "success, % (95 % interval)", kind
    )


def plot_stages(
    agents: Mapping[str, Mapping[str, Spread]], printed: Mapping[str, Spread], kind: str
) -> bytes:
    """Draw planning times by stage: median and quartiles on a logarithmic axis.

    Args:
        agents: agent -> stage -> median and quartiles, s.
        printed: stage -> the paper's, s.
        kind: "svg" or "png".
    """
    stages = [s for s in _PAPER_STAGE if any(s in own for own in agents.values())]
    figure, axes = _new_figure(1.1 + _ROW * len(stages) * (1 + 0.5 * len(agents)))
    series = [(name, f"C{i}", own) for i, (name, own) in enumerate(agents.items())]
    series += [("paper", "0.35", printed)] if printed else []
    for i, (name, colour, own) in enumerate(series):
        offset = (i - 0.5 * (len(series) - 1)) * 0.22
        shown = {y + offset: own[s] for y, s in enumerate(stages) if s in own}
        middle, ends = _bars([max(value, _LEAST_SECONDS) for value in spread] for spread in shown.values())
        axes.errorbar(middle, list(shown), xerr=ends, fmt="o", color=colour, label=name, **_STYLE)
    axes.set_xscale("log")
    names = [_PAPER_STAGE[s] for s in stages]
    return _of_rows(figure, axes, names, "seconds: median, 25th and 75th percentile", kind)


def plot_curves(
    series: Mapping[str, Sequence[tuple[float, Counts]]], label: str, height: float, kind: str
) -> bytes:
    """Draw success rates with Wilson intervals against a quantity.

    Args:
        series: agent -> (value, counts) of each point.
        label: what the value is.
        height: of the figure, inches.
        kind: "svg" or "png".
    """
    figure, axes = _new_figure(height)
    for i, (agent, points) in enumerate(series.items()):
        rates, ends = _bars(_rate(counts) for _, counts in points)
        values = [value for value, _ in points]
        axes.errorbar(values, rates, yerr=ends, fmt="o-", color=f"C{i}", label=agent, **_STYLE)
    axes.set(ylim=(-3, 103), xlabel=label, ylabel="success, % (95 % interval)")
    axes.grid(axis="y", color="0.9", lw=0.8)
    return _finished(figure, axes, kind)


def _rate(counts: Counts) -> Spread:
    """Return a success rate and the ends of Wilson's interval, percent."""
    return [100.0 * value for value in (counts[0] / counts[1], *wilson_interval(*counts))]


def _bars(spreads: Iterable[Spread]) -> tuple[Array, Array]:
    """Return middles (N,) and the lengths of error bars below and above (2, N)."""
    middle, low, high = np.array(list(spreads), dtype=float).reshape(-1, 3).T
    return middle, np.maximum([middle - low, high - middle], 0.0)


def _new_figure(height: float) -> tuple[Any, Any]:
    """Return a figure of the report's width and its axes; `height` in inches."""
    from matplotlib.figure import Figure as Canvas

    figure = Canvas(figsize=(_WIDTH, height), layout="constrained")
    return figure, figure.add_subplot()


def _of_rows(figure: Any, axes: Any, names: Sequence[str], label: str, kind: str) -> bytes:
    axes.set_yticks(range(len(names)), names)
    axes.set(ylim=(len(names) - 0.45, -0.55), xlabel=label)
    return _finished(figure, axes, kind)


def _finished(figure: Any, axes: Any, kind: str) -> bytes:
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
