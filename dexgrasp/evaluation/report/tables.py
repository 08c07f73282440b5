"""Results as tables: agents by sets, objects one by one, the paper's figures beside ours."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from dexgrasp.evaluation.reasons import sentence
from dexgrasp.evaluation.report import paper
from dexgrasp.runs.text import left_table, seconds_words, text_table
from dexgrasp_env.objects.catalogue import OBJECT_SETS

Summary = Mapping[str, Any]
T = TypeVar("T")
Table = Callable[[Sequence[str], Sequence[Sequence[str]]], T]
"""What makes a table of a header and rows: text for a terminal, markdown, or a block of a document."""
_SET_NAMES = ("seen", "familiar", "novel", "ycb6", "meshes")


def render_summary(summary: Summary) -> str:
    """Return the tables of one evaluation for a terminal."""
    agents = summary["agents"]
    parts = [set_table(agents, text_table), object_table(agents, text_table)]
    failures = failure_rows(agents)
    if failures:
        parts.append(left_table(("agent", "trials", "failed because"), failures))
    parts += [_paired_line(pair) for pair in summary.get("paired", []) if pair["only_a"] + pair["only_b"] > 0]
    return "\n\n".join(parts)


def set_table(agents: Mapping[str, Any], table: Table[T]) -> T:
    """Return agents by sets with intervals and planning times; the paper's row follows an agent that it has."""
    sets = [name for name in _SET_NAMES if any(name in a["by_set"] for a in agents.values())]
    header = ["agent", "all", *sets, "stable", "planning s"]
    rows = []
    for name, agent in agents.items():
        cells = [_rate(agent["by_set"].get(s)) for s in sets]
        rows.append([name, _rate(agent), *cells, _share(agent), _median(agent["planning_seconds"])])
        printed = {s: paper.set_successes(name, OBJECT_SETS[s]) for s in sets if s in paper.TABLES}
        if any(printed.values()):
            rows.append(["  paper (real robot)", "", *(_printed(printed.get(s)) for s in sets), "", ""])
    return table(header, rows)


def object_table(agents: Mapping[str, Any], table: Table[T]) -> T:
    """Return objects by agents, ours and in brackets the paper's."""
    objects = list(dict.fromkeys(o for agent in agents.values() for o in agent["by_object"]))
    ordered = [o for names in OBJECT_SETS.values() for o in names]
    objects.sort(key=lambda o: ordered.index(o) if o in ordered else len(ordered))
    rows = [
        [name, *(_object_cell(agent_name, agent, name) for agent_name, agent in agents.items())]
        for name in objects
    ]
    has_paper = any(o in paper.SUCCESSES.get(name, {}) for name in agents for o in objects)
    return table(["object" + (" (paper)" if has_paper else ""), *agents], rows)


def failure_rows(agents: Mapping[str, Any]) -> list[list[str]]:
    """Return agent, count and reason of every kind of failure."""
    return [
        [name, str(n), _in_words(reason)]
        for name, agent in agents.items()
        for reason, n in agent["failures"].items()
    ]


def _in_words(reason: str) -> str:
    words = sentence(reason)
    return reason if words == reason else f"{words} [{reason}]"


def _object_cell(agent_name: str, agent: Mapping[str, Any], name: str) -> str:
    own = agent["by_object"].get(name)
    printed = paper.SUCCESSES.get(agent_name, {}).get(name)
    ours = f"{own['successes']}/{own['trials']}" if own else "-"
    return f"{ours} ({printed[0]}/{printed[1]})" if printed else ours


def rate_words(cell: Mapping[str, Any] | None) -> str:
    """Return a success rate with its interval as people read it; "-" where nothing was tried."""
    if not cell or not cell["trials"]:
        return "-"
    low, high = (100 * end for end in cell["ci95"])
    return f"{100 * cell['rate']:.1f} % [{low:.0f}, {high:.0f}]"


def _rate(cell: Mapping[str, Any] | None) -> str:
    return f"{rate_words(cell)} {cell['successes']}/{cell['trials']}" if cell and cell["trials"] else "-"


def _printed(cell: tuple[int, int] | None) -> str:
    return "" if cell is None else f"{100 * cell[0] / cell[1]:.1f} % {cell[0]}/{cell[1]}"


def _share(agent: Mapping[str, Any]) -> str:
    return f"{agent.get('stable', 0)}/{agent['successes']}"


def _median(times: Mapping[str, float]) -> str:
    return seconds_words(times["median"]) if times else "-"


def _paired_line(pair: Mapping[str, Any]) -> str:
    return (
        f"{pair['a']} against {pair['b']} on the same scenes: {pair['only_a']} solved by {pair['a']} alone, "
        f"{pair['only_b']} by {pair['b']} alone (exact McNemar p = {pair['p_value']:.3g})"
    )
