"""Some scenes' demonstrations as arrays, while the others are made."""

import json
from collections.abc import Sequence
from pathlib import Path

from dexgrasp.demos.rollout import Episode
from dexgrasp.runs.arrays import below
from dexgrasp.runs.shards import bytes_of, read_shard, text_of
from dexgrasp_env.arrays import Arrays


def part_arrays(episodes: Sequence[Episode], failures: Sequence[str]) -> Arrays:
    """Return demonstrations, and why others failed, as `write_shard` takes them."""
    note = {"about": [episode.about for episode in episodes], "failures": failures}
    arrays: Arrays = {"note": bytes_of(json.dumps(note))}
    for i, episode in enumerate(episodes):
        arrays |= {f"{i}/{name}": array for name, array in episode.arrays().items()}
    return arrays


def read_part(path: Path, key: str) -> tuple[list[Episode], list[str]]:
    """Return demonstrations and failures of a file.

    Raises:
        InputError: missing, damaged, or of other settings.
    """
    arrays = read_shard(path, key)
    note = json.loads(text_of(arrays["note"]))
    episodes = [Episode.of_arrays(below(arrays, f"{i}/"), about) for i, about in enumerate(note["about"])]
    return episodes, note["failures"]
