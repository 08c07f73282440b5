"""The paper's own results, from paper.yaml: Tables 1-6 of its supplementary material."""

from collections.abc import Mapping
from pathlib import Path

import yaml

from dexgrasp_env.objects.catalogue import OBJECT_SETS

_PRINTED = yaml.safe_load(Path(__file__).with_name("paper.yaml").read_text())

TABLES: Mapping[str, str] = _PRINTED["tables"]
"""Set -> the table that reports its successes."""

DISTANCES_CM: Mapping[str, list[float]] = _PRINTED["distances_cm"]
"""Set -> median, least, greatest, greatest violation: Table 4."""

RATIOS: Mapping[str, Mapping[str, list[float]]] = _PRINTED["ratios"]
"""Set -> "force" and "torque" -> median, 25th and 75th percentile of the ratios, percent: Table 5."""

SECONDS: Mapping[str, Mapping[str, list[float]]] = _PRINTED["seconds"]
"""Set -> stage -> median, 25th and 75th percentile of seconds: Table 6."""


def successes(agent: str) -> dict[str, dict[str, int]]:
    """Return object, or set of which all were tried, -> `successes` and `trials` as the paper prints them."""
    own = _PRINTED["successes"].get(agent, {"objects": {}})
    found = {name: {"successes": count, "trials": own["trials"]} for name, count in own["objects"].items()}
    for name in TABLES:
        cells = [found[target] for target in OBJECT_SETS[name] if target in found]
        if len(cells) == len(OBJECT_SETS[name]):
            found[name] = {key: sum(cell[key] for cell in cells) for key in cells[0]}
    return found
