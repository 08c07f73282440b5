"""The paper's own results, from paper.yaml: Tables 1-6 of its supplementary material."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from dexgrasp_env.objects.catalogue import OBJECT_SETS

_PRINTED: dict[str, Any] = yaml.safe_load((Path(__file__).parent / "paper.yaml").read_text())

TABLES: Mapping[str, str] = _PRINTED["tables"]
"""Set -> the table that reports its successes."""

SUCCESSES: Mapping[str, Mapping[str, tuple[int, int]]] = {
    agent: {name: (successes, own["trials"]) for name, successes in own["objects"].items()}
    for agent, own in _PRINTED["successes"].items()
}
"""Agent -> object -> (successes, trials): Tables 1-3."""

DISTANCES_CM: Mapping[str, list[float]] = _PRINTED["distances_cm"]
"""Set -> median, least, greatest, greatest violation: Table 4."""

RATIOS: Mapping[str, Mapping[str, list[float]]] = _PRINTED["ratios"]
"""Set -> "force" and "torque" -> median, 25th and 75th percentile of the ratios, percent: Table 5."""

SECONDS: Mapping[str, Mapping[str, list[float]]] = _PRINTED["seconds"]
"""Set -> stage -> median, 25th and 75th percentile of seconds: Table 6."""


def set_successes(agent: str) -> dict[str, tuple[int, int]]:
    """Return set -> (successes, trials) as the paper prints it, without the sets of which it tried not all objects."""
    own = SUCCESSES.get(agent, {})
    found = {}
    for name in TABLES:
        counts = [own[target] for target in OBJECT_SETS[name] if target in own]
        if len(counts) == len(OBJECT_SETS[name]):
            found[name] = (sum(k for k, _ in counts), sum(n for _, n in counts))
    return found
