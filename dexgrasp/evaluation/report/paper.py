"""The paper's own results, from paper.yaml: Tables 1-6 of its supplementary material."""

from pathlib import Path

from dexgrasp_env.objects.catalogue import OBJECT_SETS
from dexgrasp_env.yaml_file import read_yaml

PRINTED = read_yaml(Path(__file__).with_name("paper.yaml"))
"""`tables`: set -> the table of its successes (1 to 3). By set `distances_cm`: median, least, greatest, greatest
violation (4); `ratios` of force and torque, percent (5), `seconds` by stage (6): median, 25th and 75th percentile."""


def successes(agent: str) -> dict[str, dict[str, int]]:
    """Return the paper's `successes` and `trials` by object, and by set of which all objects were tried."""
    own = PRINTED["successes"].get(agent, {"objects": {}})
    found = {name: {"successes": count, "trials": own["trials"]} for name, count in own["objects"].items()}
    for name in PRINTED["tables"]:
        cells = [found[target] for target in OBJECT_SETS[name] if target in found]
        if len(cells) == len(OBJECT_SETS[name]):
            found[name] = {key: sum(cell[key] for cell in cells) for key in cells[0]}
    return found
