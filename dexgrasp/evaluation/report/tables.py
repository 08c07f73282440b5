"""Results as tables: agents by sets, objects one by one, the paper's figures beside ours."""

from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

from dexgrasp.evaluation.comparison import compare_rows
from dexgrasp.evaluation.pooling import Rows
from dexgrasp.evaluation.prediction import PREDICTORS, Prediction
from dexgrasp.evaluation.reasons import sentence
from dexgrasp.evaluation.report import paper
from dexgrasp.evaluation.summary import bare_count, grouped
from dexgrasp.runs.text import left_table, seconds_words, text_table
from dexgrasp_env.objects.catalogue import OBJECT_SETS

Agents = Mapping[str, Mapping[str, Any]]
"""Agent -> its part of the summary."""

SETS = ("seen", "familiar", "novel", "ycb6", "meshes")
"""Sets in the order of their columns."""


class Table(NamedTuple):
    """What is shown in columns."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def render_summary(summary: Mapping[str, Any]) -> str:
    """Return the tables of one evaluation for a terminal."""
    agents = summary["agents"]
    parts = [text_table(*set_table(agents)), text_table(*object_table(agents))]
    failures = _failures(agents)
    if failures:
        rows = [
            [name, n, why if sentence(why) == why else f"{sentence(why)} [{why}]"]
            for name, n, why in failures
        ]
        parts.append(left_table(("agent", "trials", "failed because"), rows))
    parts += [_paired_line(pair) for pair in summary.get("paired", []) if pair["only_a"] + pair["only_b"] > 0]
    return "\n\n".join(parts)


def _paired_line(pair: Mapping[str, Any]) -> str:
    return (
        f"{pair['a']} against {pair['b']} on the same scenes: {pair['only_a']} solved by {pair['a']} alone, "
        f"{pair['only_b']} by {pair['b']} alone (exact McNemar p = {pair['p_value']:.3g})"
    )


def set_table(agents: Agents) -> Table:
    """Return agents by sets with intervals and planning times; the paper's row follows an agent that it has."""
    sets = [name for name in SETS if any(name in a["by_set"] for a in agents.values())]
    rows = []
    for name, agent in agents.items():
        times = agent["planning_seconds"]
        stable = f"{agent.get('stable', 0)}/{agent['successes']}"
        cells = [_rate(agent["by_set"].get(s)) for s in sets]
        rows.append([name, _rate(agent), *cells, stable, seconds_words(times["median"]) if times else "-"])
        printed = paper.set_successes(name)
        if any(s in printed for s in sets):
            rows.append(["  paper (real robot)", "", *(_printed(printed.get(s)) for s in sets), "", ""])
    return Table(["agent", "all", *sets, "stable", "planning s"], rows)


def tries_table(agents: Agents) -> Table:
    """Return intervals for claims about other objects, and the success within one to three tries."""
    rows = []
    for name, agent in agents.items():
        tries = [agent["within_tries"].get(k) for k in ("1", "2", "3")]
        words = ["-" if p is None else f"{100 * p:.1f} %" for p in tries]
        rows.append([name, _interval(agent["ci95_objects"]), *words])
    return Table(("agent", "95 % over objects", "first try", "within 2", "within 3"), rows)


def protocol_table(agents: Agents, names: Sequence[str]) -> Table:
    """Return protocols by agents."""
    rows = [[p, *(rate_words(agent["by_protocol"].get(p)) for agent in agents.values())] for p in names]
    return Table(("protocol", *agents), rows)


def ordered_objects(agents: Agents) -> list[str]:
    """Return the objects that agents were tried on: those of sets first, in their order."""
    ordered = {o: None for names in OBJECT_SETS.values() for o in names}
    tried = dict.fromkeys(o for agent in agents.values() for o in agent["by_object"])
    return [o for o in ordered if o in tried] + [o for o in tried if o not in ordered]


def object_table(agents: Agents, among: Collection[str] | None = None) -> Table:
    """Return objects by agents, ours and in brackets the paper's; of some objects alone where `among` names them."""
    objects = [o for o in ordered_objects(agents) if among is None or o in among]
    own = {name: a["by_object"] for name, a in agents.items() if any(o in objects for o in a["by_object"])}
    rows = [
        [target, *(_object_cell(name, own[name].get(target), target) for name in own)] for target in objects
    ]
    has_paper = any(o in paper.SUCCESSES.get(name, {}) for name in own for o in objects)
    return Table(["object" + (" (paper)" if has_paper else ""), *own], rows)


def object_tables(agents: Agents) -> list[tuple[str, Table]]:
    """Return titles and tables of the objects of the paper's Tables 1-3, and of all others."""
    groups: dict[str, Collection[str]] = {
        f"{s.capitalize()} objects ({number})": OBJECT_SETS[s] for s, number in paper.TABLES.items()
    }
    printed = {o for members in groups.values() for o in members}
    groups["Other objects"] = [o for o in ordered_objects(agents) if o not in printed]
    tables = {title: object_table(agents, members) for title, members in groups.items()}
    return [(title, table) for title, table in tables.items() if table.rows]


def where_objects_fail(rows: Rows, protocols: Sequence[str | None]) -> list[tuple[str, Table]]:
    """Return objects by protocols for each agent that failed; cells without a failure are left empty."""
    tables = []
    for agent, own in rows.items():
        failing = [
            cell for cell in grouped(own, "object").items() if not all(row["success"] for row in cell[1])
        ]
        body = []
        for target, trials in failing:
            counts = {name: bare_count(part) for name, part in grouped(trials, "protocol").items()}
            body.append([target, *(_missed(counts.get(name)) for name in protocols)])
        if body:
            tables.append((agent, Table(("object", *(name or "" for name in protocols)), body)))
    return tables


def paired_table(rows: Rows) -> Table:
    """Return agents two by two on the same scenes; across evaluations those of equal seeds."""
    body = []
    for a, b in combinations(rows, 2):
        found = compare_rows([{**row, "agent": name} for name in (a, b) for row in rows[name]], a, b)
        if found["scenes"]:
            counts = [str(found[key]) for key in ("both", "only_a", "only_b", "neither")]
            low, high = (100 * end for end in found["ci95"])
            difference = f"{100 * found['difference']:+.1f} [{low:+.0f}, {high:+.0f}]"
            body.append([a, b, *counts, difference, f"{found['p_value']:.3g}"])
    header = ("first", "second", "both", "first alone", "second alone", "neither", "difference, points", "p")
    return Table(header, body)


def failure_table(agents: Agents) -> Table:
    """Return how often each agent failed, and why, in words."""
    return Table(("agent", "trials", "why"), [[name, n, sentence(why)] for name, n, why in _failures(agents)])


def prediction_table(found: Mapping[str, Mapping[str, Prediction]]) -> Table:
    """Return how well fields of the certificate told successes from failures: agent -> field -> areas."""
    rows = [
        [agent, PREDICTORS[name], str(p.trials), f"{p.auc:.2f} [{p.interval[0]:.2f}, {p.interval[1]:.2f}]"]
        for agent, own in found.items()
        for name, p in own.items()
    ]
    return Table(("agent", "value", "trials", "area, 95 %"), rows)


def rate_words(cell: Mapping[str, Any] | None) -> str:
    """Return a success rate with its interval as people read it; "-" where nothing was tried."""
    return f"{100 * cell['rate']:.1f} % {_interval(cell['ci95'])}" if cell and cell["trials"] else "-"


def _failures(agents: Agents) -> list[tuple[str, str, str]]:
    """Return agent, count and reason of every kind of failure."""
    return [(name, str(n), why) for name, agent in agents.items() for why, n in agent["failures"].items()]


def _interval(ends: Sequence[float]) -> str:
    low, high = (100 * end for end in ends)
    return f"[{low:.0f}, {high:.0f}]"


def _rate(cell: Mapping[str, Any] | None) -> str:
    return f"{rate_words(cell)} {cell['successes']}/{cell['trials']}" if cell and cell["trials"] else "-"


def _printed(cell: tuple[int, int] | None) -> str:
    return "" if cell is None else f"{100 * cell[0] / cell[1]:.1f} % {cell[0]}/{cell[1]}"


def _object_cell(agent: str, cell: Mapping[str, int] | None, target: str) -> str:
    printed = paper.SUCCESSES.get(agent, {}).get(target)
    ours = f"{cell['successes']}/{cell['trials']}" if cell else "-"
    return f"{ours} ({printed[0]}/{printed[1]})" if printed else ours


def _missed(cell: Mapping[str, int] | None) -> str:
    if cell is None:
        return "-"
    return "" if cell["successes"] == cell["trials"] else f"{cell['successes']}/{cell['trials']}"
