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
    objects = list(dict.fromkeys(row["object"] for row, _ in pairs))
    protocols = dict.fromkeys(row.get("protocol") for row, _ in every)
    return {
        **_statistics(pairs),
        "repeated": len(every) - len(pairs),
        "by_set": {
            name: _statistics([p for p in pairs if p[0]["object"] in members])
            for name, members in present_sets(objects).items()
        },
        "by_object": {name: _statistics([p for p in pairs if p[0]["object"] == name]) for name in objects},
        **(
            {
                "by_protocol": {
                    n: _statistics([p for p in every if p[0].get("protocol") == n]) for n in protocols
                }
            }
            if len(protocols) > 1
            else {}
        ),
        "discordant": [_discordant(p, a, b) for p in pairs if p[0]["success"] != p[1]["success"]],
    }


def _scene(row: Row) -> tuple[object, ...]:
    """What makes two trials the same scene."""
    return row.get("protocol"), row["object"], row["trial"], row.get("scene_seed")


def _trial(row: Row) -> tuple[object, ...]:
    """What makes two trials of an agent the same: the scene and, under any protocol, every number that came of it."""
    played = [row.get(key) for key in ("success", "steps", "total_reward", "height", "slip", "tilt")]
    return row["object"], row["trial"], row.get("scene_seed"), *(_scene(row) if None in played else played)


def _statistics(pairs: Sequence[tuple[Row, Row]]) -> dict[str, Any]:
    """Return counts, rates, difference with intervals, the exact test and the sequential test's capital."""
    firsts, seconds = [x for x, _ in pairs], [y for _, y in pairs]
    counts = mcnemar(
        {i: bool(row["success"]) for i, row in enumerate(firsts)},
        {i: bool(row["success"]) for i, row in enumerate(seconds)},
    )
    table = [int(counts[key]) for key in ("both", "only_a", "only_b", "neither")]
    n = max(len(pairs), 1)
    return {
        "scenes": len(pairs),
        "rate_a": (table[0] + table[1]) / n,
        "rate_b": (table[0] + table[2]) / n,
        "difference": (table[1] - table[2]) / n,
        "ci95": list(paired_difference_interval(*table)),
        "ci95_objects": list(object_difference_interval(object_counts(firsts), object_counts(seconds))),
        **counts,
        "e_value": capital(table[1], table[2]),
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
        lines = [
            [
                d["object"],
                str(d["trial"]),
                str(d.get("scene_seed", "")),
                d["solved_by"],
                d["reason_of_the_other"] or "",
            ]
            for d in content["discordant"]
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
    verdict = (
        f"{better} solves more of these scenes than {worse}"
        if content["p_value"] <= 0.05
        else "these scenes show no difference"
    )
    repeated = content["repeated"]
    again = (
        f" {repeated} trials repeat others: their protocols change nothing for these two." if repeated else ""
    )
    return (
        f"Exact McNemar test, two-sided: p = {content['p_value']:.3g}: {verdict}. For new objects like these the "
        f"difference is {100 * low:+.1f} to {100 * high:+.1f} points (objects drawn anew). Evidence that may be looked "
        f"at any time: e-value {content['e_value']:.3g} (20 decides at 5 %).{again}"
    )
