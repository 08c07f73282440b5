"""Tables of results, the paper's figures beside ours: agents by set and object, constraints and times."""

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

from dexgrasp.evaluation.comparison import compare_rows, difference_words
from dexgrasp.evaluation.pooling import TrialsByAgent
from dexgrasp.evaluation.reasons import sentence
from dexgrasp.evaluation.report import paper
from dexgrasp.runs.text import seconds_words, text_table
from dexgrasp_env.arrays import Fields
from dexgrasp_env.objects.catalogue import OBJECT_SETS

Agents = Mapping[str, Fields]
"""Agent -> its part of the summary."""

PLANNER = "bilevel"
"""Agent whose times are compared with Table 6, which is of the paper's planner only."""


class Table(NamedTuple):
    """Cells of a table as text."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def render_summary(summary: Fields) -> str:
    """Return the tables of one evaluation for a terminal."""
    agents = summary["agents"]
    protocols = list(dict.fromkeys(name for agent in agents.values() for name in agent["by_protocol"]))
    if len(protocols) > 1:  # sets and objects would be averaged over all of them
        parts = [text_table(*protocol_table(agents, protocols))]
    else:
        parts = [text_table(*set_table(agents)), text_table(*object_table(agents))]
    if (clutter := clutter_table(agents)).rows:
        parts.append(text_table(*clutter))
    if (failures := failure_table(agents)).rows:
        parts.append(text_table(*failures, words=True))
    return "\n\n".join(parts)


def present(agents: Agents) -> list[str]:
    """Return the sets that objects were tried of, in the order of the columns."""
    names = ("seen", "familiar", "novel", "ycb6", "meshes")
    return [name for name in names if any(name in a["by_set"] for a in agents.values())]


def set_table(agents: Agents) -> Table:
    """Return agents by sets, with intervals and planning times; the paper's row follows an agent that it reports."""
    sets, rows = present(agents), []
    for name, agent in agents.items():
        cells = (agent, *map(agent["by_set"].get, sets))
        rates = [f"{rate_words(cell)} {_count(cell)}" if cell else "-" for cell in cells]
        rates.insert(1, _interval(agent["ci95_objects"]))
        stable, times = f"{agent['stable']}/{agent['successes']}", agent["planning_seconds"]
        rows.append([name, *rates, stable, seconds_words(times["median"]) if times else "-"])
        theirs = list(map(paper.successes(name).get, sets))
        if any(theirs):
            printed = [f"{100 * c['successes'] / c['trials']:.1f} % {_count(c)}" if c else "" for c in theirs]
            rows.append(["  paper (real robot)", "", "", *printed, "", ""])
    return Table(["agent", "all", "95 % over objects", *sets, "stable", "planning s"], rows)


def protocol_table(agents: Agents, names: Sequence[str]) -> Table:
    """Return success rates, a row for each protocol and a column for each agent."""
    rows = [[p, *(rate_words(agent["by_protocol"].get(p)) for agent in agents.values())] for p in names]
    return Table(("protocol", *agents), rows)


def clutter_table(agents: Agents) -> Table:
    """Return agents by protocols with neighbours: rates of lifts, clean lifts, and hits of a neighbour."""
    rows = []
    for name, agent in agents.items():
        for protocol, found in agent["clutter"].items():
            cells = (agent["by_protocol"][protocol], found["clean"], found["hit"])
            moved = f"{100 * found['moved']['median']:.1f} (up to {100 * found['moved']['max']:.1f})"
            most = ", ".join(f"{what} {n}" for what, n in list(found["hit_objects"].items())[:3])
            rows.append([protocol, name, *map(rate_words, cells), moved, most])
    header = (
        "protocol",
        "agent",
        "lifted",
        "clean",
        "hit a neighbour",
        "moved, cm, median",
        "hit most often",
    )
    return Table(header, rows)


def ordered_objects(agents: Agents) -> list[str]:
    """Return the objects that agents were tried on: those of the sets first, in their order."""
    ordered = dict.fromkeys(o for names in OBJECT_SETS.values() for o in names)
    tried = dict.fromkeys(o for agent in agents.values() for o in agent["by_object"])
    return [o for o in ordered if o in tried] + [o for o in tried if o not in ordered]


def object_table(agents: Agents, among: Collection[str] | None = None) -> Table:
    """Return successes by object and agent, the paper's in brackets; `among` restricts the objects."""
    objects = [o for o in ordered_objects(agents) if among is None or o in among]
    own = {name: a["by_object"] for name, a in agents.items() if any(o in objects for o in a["by_object"])}
    printed = {name: paper.successes(name) for name in own}
    rows = []
    for o in objects:
        cells = [
            _count(cells.get(o)) + (f" ({_count(printed[name][o])})" if o in printed[name] else "")
            for name, cells in own.items()
        ]
        rows.append([o, *cells])
    has_paper = any(o in cells for cells in printed.values() for o in objects)
    return Table(["object" + (" (paper)" if has_paper else ""), *own], rows)


def object_tables(agents: Agents) -> list[tuple[str, Table]]:
    """Return titles and tables of the objects of the paper's Tables 1-3, and of all others."""
    groups: dict[str, Collection[str]] = {
        f"{s.capitalize()} objects ({number})": OBJECT_SETS[s]
        for s, number in paper.PRINTED["tables"].items()
    }
    of_sets = {o for members in groups.values() for o in members}
    groups["Other objects"] = [o for o in ordered_objects(agents) if o not in of_sets]
    return [
        (title, table) for title, members in groups.items() if (table := object_table(agents, members)).rows
    ]


def paired_table(rows: TrialsByAgent) -> Table:
    """Return the paired comparison of every two agents on their common scenes."""
    body = []
    for a, b in combinations(rows, 2):
        found = compare_rows([{**row, "agent": name} for name in (a, b) for row in rows[name]], a, b)
        if found["scenes"]:
            counts = [str(found[key]) for key in ("both", "only_a", "only_b", "neither")]
            body.append([a, b, *counts, " ".join(difference_words(found)), f"{found['p_value']:.3g}"])
    header = ("first", "second", "both", "first alone", "second alone", "neither", "difference, points", "p")
    return Table(header, body)


def failure_table(agents: Agents) -> Table:
    """Return the failures of each agent by reason: count, words and code."""
    rows = [
        (name, str(n), f"{sentence(why)} [{why}]" if sentence(why) != why else why)
        for name, agent in agents.items()
        for why, n in agent["failures"].items()
    ]
    return Table(("agent", "trials", "why"), rows)


def constraint_tables(name: str, agent: Fields) -> list[tuple[str, Table]]:
    """Return titles and tables of an agent's constraints and times, as far as it reports them."""
    constraints = agent["constraints"]
    groups = {**constraints.get("by_set", {}), "overall": constraints} if constraints else {}
    tables = []
    if any("distance_cm" in group for group in groups.values()):
        tables.append((f"Fingertip-object distance, cm, {name} (Table 4)", _distances(groups)))
    if any("force_ratio_percent" in group for group in groups.values()):
        tables.append((f"Force and torque ratio, percent, {name} (Table 5)", _ratios(groups)))
    if agent["planning_seconds"]:
        title = f"Planning time, s, {name}{' (Table 6)' if name == PLANNER else ''}"
        tables.append((title, _times(agent, paper.PRINTED["seconds"] if name == PLANNER else {})))
    return tables


def _distances(groups: Fields) -> Table:
    keys = ("median", "min", "max", "max_violation")
    rows = []
    for group, content in groups.items():
        own = content.get("distance_cm")
        printed = ", ".join(f"{value:.2f}" for value in paper.PRINTED["distances_cm"].get(group, ()))
        rows.append([group, *(f"{own[key]:.2f}" if own else "-" for key in keys), printed])
    return Table(("set", "median", "min.", "max.", "max. violation", "paper"), rows)


def _ratios(groups: Fields) -> Table:
    rows = []
    for group, content in groups.items():
        printed = paper.PRINTED["ratios"].get(group, {})
        cells = [
            cell
            for kind in ("force", "torque")
            for cell in (_quartiles(content.get(f"{kind}_ratio_percent")), _range_words(printed.get(kind)))
        ]
        rows.append([group, *cells])
    return Table(("set", "force ratio", "paper", "torque ratio", "paper"), rows)


def _times(agent: Fields, printed: Mapping[str, Mapping[str, Sequence[float]]]) -> Table:
    ours = _quartiles(agent["planning_seconds"], seconds_words)
    theirs = _range_words(printed.get("overall", {}).get("total"), seconds_words)
    rows = [["total, overall", ours, "", theirs]]
    for group in paper.PRINTED["seconds"]:
        own = agent["stages"].get(group, {})
        for stage, seconds in own.get("stage_seconds", {}).items():
            ours, repeats = _quartiles(seconds, seconds_words), own.get("stage_repeats", {}).get(stage)
            theirs = _range_words(printed.get(group, {}).get(stage), seconds_words)
            rows.append([f"{stage}, {group}", ours, _quartiles(repeats), theirs])
    return Table(("stage, set", "seconds", "repeats", "paper, seconds"), rows)


def _quartiles(values: Mapping[str, float] | None, words: Callable[[float], str] = "{:.2f}".format) -> str:
    return _range_words([values[key] for key in ("median", "p25", "p75")], words) if values else "-"


def _range_words(values: Sequence[float] | None, words: Callable[[float], str] = "{:.2f}".format) -> str:
    """Return median and quartiles as text; "" for None."""
    return "{} ({}, {})".format(*map(words, values)) if values else ""


def rate_words(cell: Fields | None) -> str:
    """Return a success rate with its interval as text; "-" without trials."""
    return f"{100 * cell['rate']:.1f} % {_interval(cell['ci95'])}" if cell and cell["trials"] else "-"


def _interval(ends: Sequence[float]) -> str:
    low, high = (100 * end for end in ends)
    return f"[{low:.0f}, {high:.0f}]"


def _count(cell: Mapping[str, int] | None) -> str:
    return f"{cell['successes']}/{cell['trials']}" if cell else "-"
