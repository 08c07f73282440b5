"""Demonstrations while they are made: npz files without pickle, written whole or not at all."""

import io
import json
import zipfile
from pathlib import Path

import numpy as np

from dexgrasp.demos.rollout import Arrays, Episode
from dexgrasp_env.files import parse_json, write_atomically

_STEPS = ("actions", "rewards", "terminations", "truncations")


def write_shard(path: Path, episodes: list[Episode], failures: list[str], key: str) -> None:
    """Write demonstrations and why others failed; `key` names what they were made from."""
    arrays: Arrays = {}
    for i, episode in enumerate(episodes):
        arrays |= {f"{i}/{name}": getattr(episode, name) for name in _STEPS}
        arrays |= {f"{i}/observations/{name}": array for name, array in episode.observations.items()}
        arrays |= {f"{i}/once/{name}": array for name, array in episode.once.items()}
    note = {"key": key, "about": [episode.about for episode in episodes], "failures": failures}
    arrays["note"] = np.frombuffer(json.dumps(note).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    write_atomically(path, buffer.getvalue())


def read_shard(path: Path, key: str) -> tuple[list[Episode], list[str]] | None:
    """Return demonstrations and failures of a file; None where it is missing, damaged, or of other settings."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        note = parse_json(arrays["note"].tobytes())
        if note["key"] != key:
            return None
        episodes = [_episode(arrays, i, about) for i, about in enumerate(note["about"])]
        return episodes, [str(reason) for reason in note["failures"]]
    except (OSError, ValueError, LookupError, TypeError, zipfile.BadZipFile):
        return None


def _episode(arrays: Arrays, i: int, about: dict[str, object]) -> Episode:
    def below(prefix: str) -> Arrays:
        return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}

    steps = {name: arrays[f"{i}/{name}"] for name in _STEPS}
    return Episode(below(f"{i}/observations/"), **steps, once=below(f"{i}/once/"), about=about)
