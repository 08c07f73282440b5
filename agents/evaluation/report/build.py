"""The report of one or more evaluations: markdown and plots."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.evaluation.report import paper
from agents.evaluation.report.constraint_tables import constraint_tables
from agents.evaluation.report.tables import failure_rows, object_table, set_table
from agents.evaluation.report.text import markdown_table
from agents.evaluation.statistics import wilson_interval
from agents.evaluation.store import read_rows
from agents.evaluation.summary import compare, summarise_agent
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_atomically
from dexgrasp_env.objects.catalogue import OBJECT_SETS

_NOTE = (
    "The paper's figures are from a real robot and objects whose sizes and masses were not published; ours are from "
    "simulation. Intervals are Wilson's at 95 %."
)


def read_agents(folders: Sequence[Path]) -> dict[str, Any]:
    """Return agents' summaries from the trials of every folder; an agent found twice bears its folder's name.

    Raises:
        InputError: if a folder holds no evaluation.
    """
    rows = _rows_by_agent(folders)
    return {name: summarise_agent(own) for name, own in rows.items()}


def _rows_by_agent(folders: Sequence[Path]) -> dict[str, list[dict[str, Any]]]:
    found: dict[str, list[dict[str, Any]]] = {}
    for folder in folders:
        rows = read_rows(folder)
        if not rows:
            raise InputError(f"{folder} holds no finished trial yet")
        for name in dict.fromkeys(row["agent"] for row in rows):
            label = name if name not in found else f"{name} ({folder.name})"
            found[label] = [row for row in rows if row["agent"] == name]
    return found


def protocol_line(folder: Path) -> str:
    """Return one line on how an evaluation was made."""
    try:
        run = json.loads((folder / "run.json").read_text())
    except (OSError, ValueError):
        return f"- `{folder.name}`: settings unknown"
    versions = ", ".join(f"{name} {version}" for name, version in run["versions"].items())
    return (
        f"- `{folder.name}`: {run['protocol']}, seed {run['seed']}, {run['trials']} trials a cell; {versions}"
    )


def write_report(folders: Sequence[Path], out: Path) -> str:
    """Write report.md and the plots to `out`, and return the markdown.

    Raises:
        InputError: if a folder holds no evaluation.
    """
    agents = read_agents(folders)
    parts = ["# Evaluation", "\n".join(protocol_line(folder) for folder in folders), _NOTE]
    parts += ["## By set", set_table(agents, markdown_table), "![by set](success_by_set.png)"]
    for name, members in {**{s: OBJECT_SETS[s] for s in paper.TABLES}, "other": None}.items():  # type: ignore[dict-item]
        own = _restricted(agents, members)
        if own:
            title = f"{name.capitalize()} objects" + (
                f" ({paper.TABLES[name]})" if name in paper.TABLES else ""
            )
            parts += [f"## {title}", object_table(own, markdown_table)]
    parts += ["![by object](success_by_object.png)"]
    if failure_rows(agents):
        parts += ["## Failures", markdown_table(("agent", "trials", "reason"), failure_rows(agents))]
    parts += _paired(folders)
    for name, agent in agents.items():
        for title, table in constraint_tables(name, agent, markdown_table):
            parts += [f"## {title}", table]
    text = "\n\n".join(parts) + "\n"
    write_plots(agents, out)
    write_atomically(out / "report.md", text.encode())
    return text


def _restricted(agents: Mapping[str, Any], members: Sequence[str] | None) -> dict[str, Any]:
    """Agents with the objects of a set alone; None stands for the objects outside Tables 1-3."""
    tested = {o for s in paper.TABLES for o in OBJECT_SETS[s]}

    def belongs(name: str) -> bool:
        return name in members if members is not None else name not in tested

    own = {
        agent: {**content, "by_object": {o: c for o, c in content["by_object"].items() if belongs(o)}}
        for agent, content in agents.items()
    }
    return {agent: content for agent, content in own.items() if content["by_object"]}


def _paired(folders: Sequence[Path]) -> list[str]:
    rows = _rows_by_agent(folders)
    names = list(rows)
    pairs = [
        compare(a, _scenes(rows[a]), b, _scenes(rows[b])) for i, a in enumerate(names) for b in names[i + 1 :]
    ]
    pairs = [pair for pair in pairs if pair["only_a"] + pair["only_b"] + pair["both"] + pair["neither"] > 0]
    if not pairs:
        return []
    body = [
        [
            p["a"],
            p["b"],
            str(p["both"]),
            str(p["only_a"]),
            str(p["only_b"]),
            str(p["neither"]),
            f"{p['p_value']:.3g}",
        ]
        for p in pairs
    ]
    header = ("first", "second", "both", "first alone", "second alone", "neither", "p (exact McNemar)")
    return ["## Scene by scene", markdown_table(header, body)]


def _scenes(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Trials of different evaluations are the same scene only if the scene's seed is the same."""
    return [{**row, "trial": (row["trial"], row["scene_seed"])} for row in rows]


def write_plots(agents: Mapping[str, Any], out: Path) -> None:
    """Write success_by_set.png and success_by_object.png: rates with 95 % intervals, the paper's as crosses."""
    out.mkdir(parents=True, exist_ok=True)
    sets = [
        s
        for s in ("seen", "familiar", "novel", "ycb6", "meshes")
        if any(s in a["by_set"] for a in agents.values())
    ]
    _plot(out / "success_by_set.png", sets, {n: a["by_set"] for n, a in agents.items()}, _paper_sets(agents))
    ordered = [o for names in OBJECT_SETS.values() for o in names]
    found = dict.fromkeys(o for a in agents.values() for o in a["by_object"])
    objects = sorted(found, key=lambda o: ordered.index(o) if o in ordered else len(ordered))
    printed = {name: paper.SUCCESSES.get(name, {}) for name in agents}
    _plot(out / "success_by_object.png", objects, {n: a["by_object"] for n, a in agents.items()}, printed)


def _paper_sets(agents: Mapping[str, Any]) -> dict[str, dict[str, tuple[int, int]]]:
    found = {name: {s: paper.set_successes(name, OBJECT_SETS[s]) for s in paper.TABLES} for name in agents}
    return {name: {s: cell for s, cell in own.items() if cell} for name, own in found.items()}


def _plot(
    path: Path,
    names: Sequence[str],
    counts: Mapping[str, Mapping[str, Mapping[str, int]]],
    printed: Mapping[str, Mapping[str, tuple[int, int]]],
) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(
        figsize=(max(5.0, 1.2 + 0.28 * len(names) * (1 + len(counts))), 4.2), layout="constrained"
    )
    axes = figure.add_subplot()
    width = 0.8 / len(counts)
    for i, (agent, own) in enumerate(counts.items()):
        shown = [
            (x + (i - 0.5 * (len(counts) - 1)) * width, own[name])
            for x, name in enumerate(names)
            if name in own
        ]
        places = [x for x, _ in shown]
        rates = [cell["successes"] / cell["trials"] for _, cell in shown]
        ends = [wilson_interval(cell["successes"], cell["trials"]) for _, cell in shown]
        errors = [
            [r - low for r, (low, _) in zip(rates, ends, strict=True)],
            [high - r for r, (_, high) in zip(rates, ends, strict=True)],
        ]
        axes.bar(
            places,
            rates,
            width,
            label=agent,
            color=f"C{i}",
            yerr=errors,
            capsize=2,
            error_kw={"lw": 0.8, "ecolor": "0.25"},
        )
        crosses = [
            (x + (i - 0.5 * (len(counts) - 1)) * width, printed[agent][n])
            for x, n in enumerate(names)
            if n in printed.get(agent, {})
        ]
        if crosses:
            label = f"{agent}, paper (real robot)"
            axes.plot(
                [x for x, _ in crosses],
                [k / n for _, (k, n) in crosses],
                "x",
                color="black",
                mfc="none",
                label=label,
            )
    axes.set_xticks(
        range(len(names)),
        [n.replace("_", " ") for n in names],
        rotation=40 if len(names) > 5 else 0,
        ha="right" if len(names) > 5 else "center",
    )
    axes.set(ylim=(0.0, 1.05), ylabel="success rate, 95 % interval")
    axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    FigureCanvasAgg(figure).print_png(str(path))
