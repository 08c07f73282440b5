"""The report of one or more evaluations: one HTML page, and markdown with plots."""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.comparison import compare_rows
from dexgrasp.evaluation.pooling import Rows, rows_by_agent
from dexgrasp.evaluation.protocol import DEFAULT_PROTOCOL
from dexgrasp.evaluation.reasons import sentence
from dexgrasp.evaluation.report import paper
from dexgrasp.evaluation.report.clips import clip_blocks
from dexgrasp.evaluation.report.constraint_tables import constraint_tables
from dexgrasp.evaluation.report.curves import hardness_blocks, prediction_blocks, where_objects_fail
from dexgrasp.evaluation.report.document import (
    Block,
    Commands,
    FigureBlock,
    Heading,
    Lines,
    Paragraph,
    TableBlock,
    as_html,
    as_markdown,
)
from dexgrasp.evaluation.report.origin import commands, describe_run, replay_commands
from dexgrasp.evaluation.report.plots import plot_rates, plot_stages
from dexgrasp.evaluation.report.tables import failure_rows, object_table, rate_words, set_table
from dexgrasp.evaluation.store import read_rows
from dexgrasp.evaluation.summary import summarise_agent
from dexgrasp_env.files import write_atomically
from dexgrasp_env.objects.catalogue import OBJECT_SETS

_TITLE = "Evaluation of grasping agents"
_NOTE = (
    "The paper's figures are from a real robot and objects whose sizes and masses were not published; ours are from "
    "simulation. Intervals are Wilson's at 95 %; “over objects” draws objects anew, for claims about other objects."
)


def read_agents(folders: Sequence[Path]) -> dict[str, Any]:
    """Return agents' summaries from the trials of every folder, pooled over seeds.

    Raises:
        InputError: if a folder holds no evaluation.
    """
    return {name: summarise_agent(own) for name, own in rows_by_agent(folders).items()}


def write_report(folders: Sequence[Path], out: Path) -> str:
    """Write report.html, report.md and its plots to `out`, and return the markdown.

    Raises:
        InputError: if a folder holds no evaluation.
    """
    rows = rows_by_agent(folders)
    agents = {name: summarise_agent(own) for name, own in rows.items()}
    blocks = _blocks(folders, rows, agents)
    text = as_markdown(blocks)
    out.mkdir(parents=True, exist_ok=True)
    for block in blocks:
        if isinstance(block, FigureBlock):
            write_atomically(out / f"{block.name}.png", block.draw("png"))
    write_atomically(out / "report.html", _bytes(as_html(_TITLE, blocks)))
    write_atomically(out / "report.md", _bytes(text))
    return text


def _bytes(text: str) -> bytes:
    """Return what is written of a text; names from files of others may hold what UTF-8 cannot."""
    return text.encode(errors="backslashreplace")


def _blocks(folders: Sequence[Path], rows: Rows, agents: Mapping[str, Any]) -> list[Block]:
    plain, where = _comparable(rows, agents)
    return [
        Heading(_TITLE, 1),
        Lines([describe_run(folder) for folder in folders]),
        Paragraph(_NOTE),
        *_by_set(plain, where),
        *_by_protocol(agents),
        *hardness_blocks(agents),
        *_by_object(plain, where),
        *where_objects_fail(rows),
        *_paired(rows),
        *_failures(agents),
        *clip_blocks(folders),
        *prediction_blocks(rows),
        *_constraints(agents),
        Heading("How to make it again"),
        Commands([line for folder in folders for line in commands(folder)]),
        *_replays(folders),
    ]


def _comparable(rows: Rows, agents: Mapping[str, Any]) -> tuple[Mapping[str, Any], str]:
    """Return the summaries that stand beside the paper's, and a title's end that says of which protocol.

    Of several protocols the plain lift is the one that the paper's figures are of; others would be averaged into it.
    """
    names = {row.get("protocol") for own in rows.values() for row in own}
    if len(names) < 2 or DEFAULT_PROTOCOL not in names:
        return agents, ""
    own = {
        name: [row for row in found if row.get("protocol") == DEFAULT_PROTOCOL]
        for name, found in rows.items()
    }
    return {
        name: summarise_agent(found) for name, found in own.items() if found
    }, f" (protocol {DEFAULT_PROTOCOL})"


def _by_set(agents: Mapping[str, Any], where: str) -> list[Block]:
    known = ("seen", "familiar", "novel", "ycb6", "meshes")
    sets = [s for s in known if any(s in a["by_set"] for a in agents.values())]
    printed = {
        name: {s: cell for s in paper.TABLES if (cell := paper.set_successes(name, OBJECT_SETS[s]))}
        for name in agents
    }
    counts = {n: {**a["by_set"], "all": a} for n, a in agents.items()}
    draw = partial(plot_rates, ["all", *sets], counts, printed)
    return [
        Heading(f"By set{where}"),
        set_table(agents, TableBlock),
        _tries_table(agents),
        FigureBlock("success_by_set", "Success by set of objects", draw),
    ]


def _tries_table(agents: Mapping[str, Any]) -> TableBlock:
    def cells(agent: Mapping[str, Any]) -> list[str]:
        low, high = agent["ci95_objects"]
        tries = [agent["within_tries"].get(k) for k in ("1", "2", "3")]
        return [
            f"[{100 * low:.0f}, {100 * high:.0f}]",
            *("-" if p is None else f"{100 * p:.1f} %" for p in tries),
        ]

    header = ("agent", "95 % over objects", "first try", "within 2", "within 3")
    return TableBlock(header, [[name, *cells(agent)] for name, agent in agents.items()])


def _by_protocol(agents: Mapping[str, Any]) -> list[Block]:
    names = list(dict.fromkeys(p for a in agents.values() for p in a["by_protocol"]))
    if len(names) < 2:
        return []
    draw = partial(plot_rates, names, {n: a["by_protocol"] for n, a in agents.items()}, {})

    body = [[p, *(rate_words(agent["by_protocol"].get(p)) for agent in agents.values())] for p in names]
    table = TableBlock(("protocol", *agents), body)
    return [Heading("By protocol"), table, FigureBlock("success_by_protocol", "Success by protocol", draw)]


def _by_object(agents: Mapping[str, Any], where: str) -> list[Block]:
    ordered = [o for names in OBJECT_SETS.values() for o in names]
    found = dict.fromkeys(o for a in agents.values() for o in a["by_object"])
    objects = sorted(found, key=lambda o: ordered.index(o) if o in ordered else len(ordered))
    printed = {name: paper.SUCCESSES.get(name, {}) for name in agents}
    draw = partial(plot_rates, objects, {n: a["by_object"] for n, a in agents.items()}, printed)
    blocks: list[Block] = [Heading(f"By object{where}")]
    groups: dict[str, Sequence[str] | None] = {**{s: OBJECT_SETS[s] for s in paper.TABLES}, "other": None}
    for name, members in groups.items():
        own = _restricted(agents, members)
        if own:
            table = f" ({paper.TABLES[name]})" if name in paper.TABLES else ""
            blocks += [Heading(f"{name.capitalize()} objects{table}", 3), object_table(own, TableBlock)]
    return [*blocks, FigureBlock("success_by_object", "Success by object", draw)]


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


def _paired(rows: Rows) -> list[Block]:
    """Agents two by two on the same scenes; trials of different evaluations are so if the scene's seed is the same."""
    body = []
    for a, b in combinations(rows, 2):
        named = [{**row, "agent": name} for name in (a, b) for row in rows[name]]
        found = compare_rows(named, a, b)
        if found["scenes"]:
            low, high = (100 * end for end in found["ci95"])
            counts = [str(found[key]) for key in ("both", "only_a", "only_b", "neither")]
            difference = f"{100 * found['difference']:+.1f} [{low:+.0f}, {high:+.0f}]"
            body.append([a, b, *counts, difference, f"{found['p_value']:.3g}"])
    if not body:
        return []
    header = ("first", "second", "both", "first alone", "second alone", "neither", "difference, points", "p")
    words = Paragraph(
        "p is of the exact McNemar test, two-sided: only scenes that one of the two alone solved count."
    )
    return [Heading("Scene by scene"), words, TableBlock(header, body)]


def _failures(agents: Mapping[str, Any]) -> list[Block]:
    if not failure_rows(agents):
        return [Heading("Failures"), Paragraph("None.")]
    rows = [
        [name, str(n), sentence(reason)]
        for name, agent in agents.items()
        for reason, n in agent["failures"].items()
    ]
    return [Heading("Failures"), TableBlock(("agent", "trials", "why"), rows, words=True)]


def _constraints(agents: Mapping[str, Any]) -> list[Block]:
    blocks: list[Block] = []
    for name, agent in agents.items():
        for title, table in constraint_tables(name, agent, TableBlock):
            blocks += [Heading(title, 3), table]
    staged = {name: _stage_seconds(agent) for name, agent in agents.items() if agent["planning_seconds"]}
    if staged:
        printed = paper.SECONDS["overall"] if "bilevel" in staged else {}
        draw = partial(plot_stages, staged, printed)
        blocks.append(
            FigureBlock("planning_times", "Planning time by stage; the paper's is of its planner", draw)
        )
    return [Heading("Constraints and times"), *blocks] if blocks else []


def _stage_seconds(agent: Mapping[str, Any]) -> dict[str, Any]:
    own = agent["stages"].get("overall", {}).get("stage_seconds", {})
    return {**own, "total": agent["planning_seconds"]}


def _replays(folders: Sequence[Path]) -> list[Block]:
    lines = [line for folder in folders for line in replay_commands(folder, read_rows(folder))]
    if not lines:
        return []
    return [Paragraph("Every trial can be watched again, exactly; the first failures:"), Commands(lines)]
