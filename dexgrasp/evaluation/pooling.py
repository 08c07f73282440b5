"""Trials of several evaluations by agent: those that differ in their seed alone are one sample."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.store import read_rows, read_run
from dexgrasp.evaluation.summary import grouped, judged
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError

TrialsByAgent = dict[str, list[Fields]]
"""Agent, as a report calls it -> its trials."""


def rows_by_agent(folders: Sequence[Path]) -> TrialsByAgent:
    """Return the trials of every agent, judged by their protocols.

    An agent of several evaluations that differ only in the seed is one agent; otherwise its label has the folder's
    name.

    Raises:
        InputError: if a folder holds no evaluation.
    """
    found: TrialsByAgent = {}
    samples: dict[str, str] = {}  # label -> what its evaluations have in common
    seeds: set[tuple[str, Any]] = set()
    for folder in folders:
        rows = [_legible(row) for row in read_rows(folder)]
        if not rows:
            raise InputError(f"{folder} holds no finished trial yet")
        sample, seed = _sample(folder)
        for name, own in grouped(rows, "agent").items():
            label = name
            if samples.get(name, sample) != sample or (name, seed) in seeds:
                label = f"{name} ({folder.name})"
                if label in samples:
                    label = f"{name} ({folder})"
            samples[label] = sample
            seeds.add((label, seed))
            found.setdefault(label, []).extend(judged(own))
    return found


def _legible(row: Fields) -> Fields:
    """Replace characters that cannot be encoded in the words of a row: file names may have them."""
    words = {key: value for key, value in row.items() if isinstance(value, str)}
    return row | {key: value.encode(errors="replace").decode() for key, value in words.items()}


def _sample(folder: Path) -> tuple[str, Any]:
    """Return the settings that evaluations of one sample share, and the seed, in which they differ."""
    try:
        run = read_run(folder)
    except InputError:  # trials without their run.json are a sample of their own
        return str(folder), None
    shared = {key: value for key, value in run.items() if key not in ("agents", "seed")}
    return json.dumps(shared, sort_keys=True), run.get("seed")
