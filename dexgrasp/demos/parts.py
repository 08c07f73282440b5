"""Some scenes' demonstrations as arrays, while the others are made."""

import json
from collections.abc import Sequence
from pathlib import Path

from dexgrasp.demos.rollout import Arrays, Episode
from dexgrasp.runs.arrays import below
from dexgrasp.runs.shards import bytes_of, read_shard, text_of

_STEPS = ("actions", "rewards", "terminations", "truncations")


def part_arrays(episodes: Sequence[Episode], failures: Sequence[str]) -> Arrays:
    """Return demonstrations, and why others failed, as `write_shard` takes them."""
    note = {"about": [episode.about for episode in episodes], "failures": failures}
    arrays: Arrays = {"note": bytes_of(json.dumps(note))}
    for i, episode in enumerate(episodes):
        arrays |= {f"{i}/{name}": getattr(episode, name) for name in _STEPS}
        arrays |= {f"{i}/observations/{name}": array for name, array in episode.observations.items()}
        arrays |= {f"{i}/once/{name}": array for name, array in episode.once.items()}
    return arrays


def read_part(path: Path, key: str) -> tuple[list[Episode], list[str]]:
    """Return demonstrations and failures of a file.

    Raises:
        InputError: missing, damaged, or of other settings.
    """
    arrays = read_shard(path, key)
    note = json.loads(text_of(arrays["note"]))
    episodes = []
    for i, about in enumerate(note["about"]):
        steps = {name: arrays[f"{i}/{name}"] for name in _STEPS}
        observations, once = (below(arrays, f"{i}/{part}/") for part in ("observations", "once"))
        episodes.append(Episode(observations, **steps, once=once, about=about))
    return episodes, note["failures"]
