"""The page on architecture: every stop of an observation is there, and none is come back to."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
STOP = re.compile(r"^\| `([\w/]+\.py)` `([\w.]+)` \|", re.MULTILINE)


def test_the_stops_of_an_observation_exist_and_differ():
    stops = STOP.findall((ROOT / "docs" / "architecture.md").read_text())
    files = [file for file, _ in stops]
    assert len(files) == len(set(files)) > 20
    for file, name in stops:
        body = ast.parse((ROOT / file).read_text()).body
        for part in name.split("."):
            found = [node for node in body if getattr(node, "name", None) == part]
            assert found, f"{file} has no {name}"
            body = found[0].body
