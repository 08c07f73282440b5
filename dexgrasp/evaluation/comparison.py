"""Two agents on the same scenes: which of them solves what the other does not."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.protocol_counts import judged
from dexgrasp.evaluation.sequential import capital
from dexgrasp.evaluation.statistics import mcnemar, object_difference_interval, paired_difference_interval
from dexgrasp.evaluation.store import read_rows
from dexgrasp.evaluation.summary import object_counts, present_sets
from dexgrasp.runs.text import left_table, text_table
from dexgrasp_env.errors import InputError, unknown_name

Row = Mapping[str, Any]
Pairs = Sequence[tuple[Row, Row]]
"""Trials of two agents on the same scenes."""


def compare_agents(folders: Sequence[Path], a: str, b: str) -> dict[str, Any]:
    """Compare two agents of evaluations on the scenes that both have tried.

    Returns:
        Counts and statistics over all scenes, `by_set`, `by_object` and (where there are several) `by_protocol`, and
        `discordant`, the scenes that one alone solved with the other's reason. A protocol that changed nothing for
        either agent (other cameras, for two that are told the state) repeats trials of another: `repeated` of them
        count in `by_protocol` only.

    Raises:
        InputError: if a folder holds no evaluation, or none a trial of one of the agents.
    """
    rows = [row for folder in folders for row in judged(read_rows(folder))]
    names = list(dict.fromkeys(row["agent"] for row in rows))
    for name in (a, b):
        if name not in names:
            raise unknown_name(f"agent of {' '.join(map(str, folders))}", name, names)
    if a == b:
        raise InputError(f"{a} against itself: name two of {', '.join(names)}")
    return {"schema": 1, "run": " ".join(map(str, folders)), "a": a, "b": b, **compare_rows(rows, a, b)}


def compare_rows(rows: Sequence[Row], a: str, b: str) -> dict[str, Any]:
    """Return the comparison of two agents from the trials of both."""
    first, second = ({_scene(row): row for row in rows if row["agent"] == name} for name in (a, b))
    every = [(first[scene], second[scene]) for scene in first if scene in second]
    pairs = list({(_trial(x), _trial(y)): (x, y) for x, y in reversed(every)}.values())[::-1]
    by_object, by_protocol = _grouped(pairs, "object"), _grouped(every, "protocol")
    sets = {
        name: [pair for member in members for pair in by_object[member]]
        for name, members in present_sets(list(by_object)).items()
    }
    several = {"by_protocol": _each(by_protocol)} if len(by_protocol) > 1 else {}
    return {
        **_statistics(pairs),
        "repeated": len(every) - len(pairs),
        "by_set": _each(sets),
        "by_object": _each(by_object),
        **several,
        "discordant": [_discordant(p, a, b) for p in pairs if p[0]["success"] != p[1]["success"]],
    }


def _grouped(pairs: Pairs, key: str) -> dict[Any, Pairs]:
    found: dict[Any, list[tuple[Row, Row]]] = {}
    for pair in pairs:
        found.setdefault(pair[0].get(key), []).append(pair)
    return dict(found)


def _each(groups: Mapping[Any, Pairs]) -> dict[Any, dict[str, Any]]:
    return {name: _statistics(pairs) for name, pairs in groups.items()}


def _scene(row: Row) -> tuple[object, ...]:
    """What makes two trials the same scene."""
    return row.get("protocol"), row["object"], row["trial"], row.get("scene_seed")


def _trial(row: Row) -> tuple[object, ...]:
    """What makes two trials of an agent the same: the scene and, under any protocol, every number that came of it."""
    played = [row.get(key) for key in ("success", "steps", "total_reward", "height", "slip", "tilt")]
    return row["object"], row["trial"], row.get("scene_seed"), *(_scene(row) if None in played else played)


def _statistics(pairs: Pairs) -> dict[str, Any]:
    """Return counts, rates, difference with intervals, the exact test and the sequential test's capital."""
    firsts, seconds = [x for x, _ in pairs], [y for _, y in pairs]
    won: list[dict[object, bool]] = [
        {i: bool(row["success"]) for i, row in enumerate(rows)} for rows in (firsts, seconds)
    ]
    counts = mcnemar(won[0], won[1])
    both, only_a, only_b, neither = (int(counts[key]) for key in ("both", "only_a", "only_b", "neither"))
    n = max(len(pairs), 1)
    return {
        "scenes": len(pairs),
        "rate_a": (both + only_a) / n,
        "rate_b": (both + only_b) / n,
        "difference": (only_a - only_b) / n,
        "ci95": list(paired_difference_interval(both, only_a, only_b, neither)),
        "ci95_objects": list(object_difference_interval(object_counts(firsts), object_counts(seconds))),
        **counts,
        "e_value": capital(only_a, only_b),
    }


def _discordant(pair: tuple[Row, Row], a: str, b: str) -> dict[str, Any]:
    """One scene that one alone solved, and why the other did not."""
    solved, failed = (a, pair[1]) if pair[0]["success"] else (b, pair[0])
    keys = ("protocol", "object", "trial", "scene_seed")
    return {
        **{k: failed[k] for k in keys if k in failed},
        "solved_by": solved,
        "reason_of_the_other": failed["reason"],
    }


def render_comparison(content: Mapping[str, Any]) -> str:
    """Return the comparison as tables for a terminal."""
    a, b = content["a"], content["b"]
    rows = [["all", *_cells(content)]]
    for group in ("by_protocol", "by_set", "by_object"):
        rows += [
            [name, *_cells(cell)]
            for name, cell in content.get(group, {}).items()
            if group != "by_object" or cell["only_a"] + cell["only_b"]
        ]
    header = ("", "scenes", a, b, "difference", "95 %", f"{a} alone", f"{b} alone", "p")
    parts = [text_table(header, rows), _sentence(content)]
    if content["discordant"]:
        keys = ("object", "trial", "scene_seed", "solved_by", "reason_of_the_other")
        lines = [
            [str(d.get(key) if d.get(key) is not None else "") for key in keys] for d in content["discordant"]
        ]
        parts.append(left_table(("object", "trial", "scene seed", "solved by", "why not the other"), lines))
    return "\n\n".join(parts)


def _cells(cell: Mapping[str, Any]) -> list[str]:
    low, high = cell["ci95"]
    return [
        str(cell["scenes"]), f"{cell['rate_a']:.1%}", f"{cell['rate_b']:.1%}", f"{100 * cell['difference']:+.1f}",
        f"[{100 * low:+.0f}, {100 * high:+.0f}]", str(cell["only_a"]), str(cell["only_b"]), f"{cell['p_value']:.3g}",
    ]  # fmt: skip


def _sentence(content: Mapping[str, Any]) -> str:
    a, b, (low, high) = content["a"], content["b"], content["ci95_objects"]
    if not content["scenes"]:
        return f"{a} and {b} have no scene in common."
    better, worse = (a, b) if content["difference"] > 0 else (b, a)
    verdict = "these scenes show no difference"
    if content["p_value"] <= 0.05:
        verdict = f"{better} solves more of these scenes than {worse}"
    repeated = content["repeated"]
    again = (
        f" {repeated} trials repeat others: their protocols change nothing for these two." if repeated else ""
    )
    return (
        f"Exact McNemar test, two-sided: p = {content['p_value']:.3g}: {verdict}. For new objects like these the "
        f"difference is {100 * low:+.1f} to {100 * high:+.1f} points (objects drawn anew). Evidence that may be looked "
        f"at any time: e-value {content['e_value']:.3g} (20 decides at 5 %).{again}"
    )
