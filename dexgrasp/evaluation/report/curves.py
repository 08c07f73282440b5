"""Success against what makes it hard (friction, mass, pushes), and against what the certificate claims."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from dexgrasp.evaluation.prediction import predictions
from dexgrasp.evaluation.report.document import Block, FigureBlock, Heading, Paragraph, TableBlock
from dexgrasp.evaluation.report.plots import finished, new_figure
from dexgrasp.evaluation.statistics import wilson_interval

CURVES: dict[str, tuple[str, tuple[tuple[float, str], ...]]] = {
    "friction": ("friction coefficient", ((0.35, "slippery@0.35"), (0.5, "slippery@0.5"), (0.7, "lift"))),
    "mass": ("mass, of the object's own", ((1.0, "lift"), (1.5, "heavy"))),
    "push": ("push at friction 0.5, of the weight", ((0.0, "slippery@0.5"), (0.5, "pushed@0.5"), (1.0, "pushed@1"))),
}  # fmt: skip
"""What is varied -> what the axis says, and (value, protocol) of each point."""
_LABELS = {"load": "load, in weights", "capacity": "capacity, in weights", "closure_margin": "closure margin"}


def hardness_blocks(agents: Mapping[str, Any]) -> list[Block]:
    """Return a figure for each quantity that at least two protocols of the evaluation vary."""
    blocks: list[Block] = []
    for name, (label, points) in CURVES.items():
        shown = [
            (value, part) for value, part in points if any(part in a["by_protocol"] for a in agents.values())
        ]
        if len(shown) > 1:
            series = {agent: _cells(content, shown) for agent, content in agents.items()}
            draw = partial(_plot_curves, series, label, 3.4)
            blocks.append(FigureBlock(f"success_by_{name}", f"Success against {label}", draw))
    return [Heading("How hard it gets"), *blocks] if blocks else []


def _cells(agent: Mapping[str, Any], points: Sequence[tuple[float, str]]) -> list[tuple[float, int, int]]:
    own = agent["by_protocol"]
    return [(value, own[p]["successes"], own[p]["trials"]) for value, p in points if p in own]


def _plot_curves(
    series: Mapping[str, Sequence[tuple[float, int, int]]], label: str, height: float, kind: str
) -> bytes:
    figure, axes = new_figure(height)
    for i, (agent, points) in enumerate(series.items()):
        _draw_points(axes, agent, f"C{i}", points)
    axes.set(ylim=(-3, 103), xlabel=label, ylabel="success, % (95 % interval)")
    axes.grid(axis="y", color="0.9", lw=0.8)
    return finished(figure, axes, kind)


def _draw_points(axes: Any, label: str, colour: str, points: Sequence[tuple[float, int, int]]) -> None:
    rates = [100.0 * k / n for _, k, n in points]
    ends = [[100.0 * end for end in wilson_interval(k, n)] for _, k, n in points]
    errors = [
        [max(rate - low, 0.0) for rate, (low, _) in zip(rates, ends, strict=True)],
        [max(high - rate, 0.0) for rate, (_, high) in zip(rates, ends, strict=True)],
    ]
    axes.errorbar(
        [x for x, _, _ in points], rates, yerr=errors, fmt="o-", ms=5, capsize=3, lw=1.3, color=colour, label=label
    )  # fmt: skip


def where_objects_fail(rows: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[Block]:
    """Return objects by protocols for each agent, where there are several; cells without a failure are left empty."""
    names = list(dict.fromkeys(row.get("protocol") or "" for own in rows.values() for row in own))
    if len(names) < 2:
        return []
    blocks: list[Block] = [
        Heading("Where objects fail"), Paragraph("Successes of trials; cells without a failure are empty.")
    ]  # fmt: skip
    for agent, own in rows.items():
        counts: dict[tuple[str, str], tuple[int, int]] = {}
        for row in own:
            k, n = counts.get((row["object"], row.get("protocol") or ""), (0, 0))
            counts[row["object"], row.get("protocol") or ""] = k + bool(row["success"]), n + 1
        failed = dict.fromkeys(target for (target, _), (k, n) in counts.items() if k < n)
        body = [[target, *(_missed(counts.get((target, name))) for name in names)] for target in failed]
        if body:
            blocks += [Heading(agent, 3), TableBlock(("object", *names), body)]
    return blocks


def _missed(cell: tuple[int, int] | None) -> str:
    if cell is None:
        return "-"
    return "" if cell[0] == cell[1] else f"{cell[0]}/{cell[1]}"


def prediction_blocks(rows: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[Block]:
    """Return how well certificates predicted the trials: areas under the curve, and reliability by load."""
    found = {agent: own for agent, trials in rows.items() if (own := predictions(trials))}
    if not found:
        return []
    body = [
        [agent, _LABELS[name], str(p.trials), f"{p.auc:.2f} [{p.interval[0]:.2f}, {p.interval[1]:.2f}]"]
        for agent, own in found.items()
        for name, p in own.items()
    ]
    words = Paragraph(
        "The chance that, of one success and one failure drawn at random, the success had the larger value in its "
        "certificate: 1 tells them apart, 0.5 says nothing. Over all trials with a certificate, of every protocol."
    )
    blocks: list[Block] = [
        Heading("What the certificate predicts"), words, TableBlock(("agent", "value", "trials", "area, 95 %"), body)
    ]  # fmt: skip
    for name in ("load", "closure_margin"):
        series = {
            agent: [(b.median, b.successes, b.trials) for b in p[name].bins]
            for agent, p in found.items()
            if name in p
        }
        if series:
            draw = partial(_plot_curves, series, f"{_LABELS[name]} (median of each part)", 3.2)
            blocks.append(
                FigureBlock(f"reliability_{name}", f"Success against {_LABELS[name]}, in equal parts", draw)
            )
    return blocks
