"""Paired comparison of two agents on the same scenes."""

import json
from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.protocol import AGENT_KEYS
from dexgrasp.evaluation.statistics import paired_comparison
from dexgrasp.evaluation.store import Trials, read_rows
from dexgrasp.evaluation.summary import grouped, judged, present_sets, scene_key
from dexgrasp.runs.text import text_table
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.files import expand

_SCENE = ("protocol", "object", "trial", "scene_seed")
"""Keys of a trial's row that identify its scene."""


def compare_agents(folders: Sequence[str | Path], a: str, b: str, protocols: Sequence[str] = ()) -> Fields:
    """Compare two agents of evaluations on the scenes that both were tried on.

    Args:
        folders: of evaluations.
        a: an agent.
        b: another one; or the same, under another protocol.
        protocols: one for each agent; empty to compare both under every protocol that they share.

    Returns:
        Counts and statistics over all trials, with the scene as the unit, `by_set`, `by_object` and (where there are
        several) `by_protocol`; and `discordant`, the trials that only one solved, with the reason of the other.

    Raises:
        InputError: if a folder holds no evaluation, or none a trial of one of the agents, or not two protocols are
            given.
    """
    rows = [row for folder in folders for row in judged(read_rows(expand(folder)))]
    run, names = " ".join(map(str, folders)), list(grouped(rows, "agent"))
    for name in (a, b):
        if name not in names:
            raise unknown_name(f"agent of {run}", name, names)
    if protocols:
        rows, (a, b) = _under(rows, (a, b), protocols)
    if a == b:
        raise InputError(f"{a} against itself: name two of {', '.join(names)}")
    return {"schema": 1, "run": run, "a": a, "b": b, **compare_rows(rows, a, b, alike=not protocols)}


def _under(rows: Trials, agents: Sequence[str], protocols: Sequence[str]) -> tuple[list[Fields], list[str]]:
    """Return the trials of each agent under its own protocol, relabelled as one protocol, and the two labels."""
    if len(protocols) != 2:
        raise InputError(f"{len(protocols)} protocols given: valid are two, one for each agent")
    met = [(row["agent"], row["protocol"]) for row in rows]
    found = list(dict.fromkeys(protocol for _, protocol in met))
    names, kept = [], list[Fields]()
    for agent, protocol in zip(agents, protocols, strict=True):
        if protocol not in found:
            raise unknown_name("protocol of the trials", protocol, found)
        names.append(f"{agent} ({protocol})")
        renamed = {"agent": names[-1], "protocol": " and ".join(protocols)}
        kept += [{**row, **renamed} for row, own in zip(rows, met, strict=True) if own == (agent, protocol)]
    return kept, names


def compare_rows(rows: Trials, a: str, b: str, alike: bool = True) -> Fields:
    """Return the comparison of two agents from the trials of both.

    Args:
        rows: trials.
        a: an agent.
        b: another one.
        alike: flag: settings of the environment must be equal too, except those that an agent chooses.

    Raises:
        InputError: if an agent's trials hold one scene twice, with different outcomes.
    """
    first, second = (_by_scene([row for row in rows if row["agent"] == name], alike) for name in (a, b))
    pairs = [{**first[scene], "other": second[scene]} for scene in first if scene in second]
    by_object, by_protocol = grouped(pairs, "object"), grouped(pairs, "protocol")
    by_set = {
        name: [pair for own in members for pair in by_object[own]]
        for name, members in present_sets(list(by_object)).items()
    }
    return {
        **_statistics(pairs),
        "by_set": _each(by_set),
        "by_object": _each(by_object),
        **({"by_protocol": _each(by_protocol)} if len(by_protocol) > 1 else {}),
        "discordant": [_discordant(x) for x in pairs if x["success"] != x["other"]["success"]],
    }


def _by_scene(rows: Trials, alike: bool) -> dict[tuple[object, ...], Fields]:
    found: dict[tuple[object, ...], Fields] = {}
    for row in rows:
        key = (*map(row.get, _SCENE), _world(row) if alike else "")
        if found.setdefault(key, row)["success"] != row["success"]:
            raise InputError(
                f"{row['agent']} met {row['object']}, trial {row['trial']}, twice and not to the same end: "
                "give folders of which each agent is in one, or whose seeds differ"
            )
    return found


def _world(row: Fields) -> str:
    """Return the settings of a scene as text: friction, robot, disturbance, but not the paths of meshes."""
    chosen = (*AGENT_KEYS, "objects", "max_episode_steps")  # by the agent, its pace, and the trial's object
    own = {key: value for key, value in (row.get("env") or {}).items() if key not in chosen}
    return json.dumps(own, sort_keys=True)


def _each(groups: Mapping[Any, Trials]) -> dict[Any, Fields]:
    return {name: _statistics(pairs) for name, pairs in groups.items()}


def _statistics(pairs: Trials) -> Fields:
    """Return counts, rates, and the difference with interval and test, by scenes and by objects.

    Args:
        pairs: trials of one agent, each with that of another on the same scene as `other`.
    """
    n = max(len(pairs), 1)
    counts, drawn = (
        paired_comparison((unit(row), row["success"], row["other"]["success"]) for row in pairs)
        for unit in (scene_key, itemgetter("object"))
    )
    return {
        "rate_a": (counts["both"] + counts["only_a"]) / n,
        "rate_b": (counts["both"] + counts["only_b"]) / n,
        "scenes": counts.pop("units"),
        "ci95_objects": drawn["ci95"],
        "p_value_objects": drawn["p_value"],
        **counts,
    }


def _discordant(row: Fields) -> Fields:
    """Return a scene that only one agent solved, and the reason of the other."""
    other = row["other"]
    solved, failed = (row, other) if row["success"] else (other, row)
    scene = {key: failed[key] for key in _SCENE}
    return scene | {"solved_by": solved["agent"], "reason_of_the_other": failed["reason"]}


def render_comparison(content: Fields) -> str:
    """Return the comparison as tables for a terminal."""
    a, b = content["a"], content["b"]
    groups = [("all", content)]
    for key in ("by_protocol", "by_set", "by_object"):
        groups += [
            (name, cell)
            for name, cell in content.get(key, {}).items()
            if key != "by_object" or cell["only_a"] + cell["only_b"]
        ]
    rows = [
        [
            name, str(cell["trials"]), str(cell["scenes"]), f"{cell['rate_a']:.1%}", f"{cell['rate_b']:.1%}",
            *difference_words(cell), str(cell["only_a"]), str(cell["only_b"]), f"{cell['p_value']:.3g}",
        ]
        for name, cell in groups
    ]  # fmt: skip
    header = ("", "trials", "scenes", a, b, "difference", "95 %", f"{a} alone", f"{b} alone", "p")
    parts = [text_table(header, rows), _sentence(content)]
    if content["discordant"]:
        keys = ("object", "trial", "scene_seed", "solved_by", "reason_of_the_other")
        scenes = [[str(own[key]) for key in keys] for own in content["discordant"]]
        about = ("object", "trial", "scene seed", "solved by", "why not the other")
        parts.append(text_table(about, scenes, words=True))
    return "\n\n".join(parts)


def difference_words(cell: Fields) -> tuple[str, str]:
    """Return a difference and its interval as text, percentage points."""
    low, high = cell["ci95"]
    return f"{100 * cell['difference']:+.1f}", f"[{100 * low:+.0f}, {100 * high:+.0f}]"


def _claim(content: Fields, interval: str, p_value: str) -> str:
    """Return the interval and the test of a difference as text, with the conclusion."""
    low, high = content[interval]
    better, worse = (content[key] for key in ("ab" if content["difference"] > 0 else "ba"))
    verdict = f"{better} solves more than {worse}" if content[p_value] <= 0.05 else "no difference is shown"
    return f"{100 * low:+.1f} to {100 * high:+.1f} points, p = {content[p_value]:.3g}: {verdict}"


def _sentence(content: Fields) -> str:
    if not content["scenes"]:
        return f"{content['a']} and {content['b']} have no scene in common."
    return (
        f"On these objects, a scene being the unit: {_claim(content, 'ci95', 'p_value')}.\n"
        f"On objects like these, the object being the unit: {_claim(content, 'ci95_objects', 'p_value_objects')}."
    )
