"""The page on architecture: its stops of an observation exist, and so do the rooms it names."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
STOP = re.compile(r"^\| `([\w/]+\.py)` `([\w.]+)` \|", re.MULTILINE)


def test_the_stops_of_an_observation_exist_and_differ():
    stops = STOP.findall((ROOT / "docs" / "architecture.md").read_text())
    files = [file for file, _ in stops]
    assert len(files) == len(set(files)) >= 15
    for file, name in stops:
        body = ast.parse((ROOT / file).read_text()).body
        for part in name.split("."):
            found = [node for node in body if getattr(node, "name", None) == part]
            assert found, f"{file} has no {name}"
            body = found[0].body


def test_every_room_is_on_the_page():
    page = (ROOT / "docs" / "architecture.md").read_text()
    rooms = {
        path.parent.name
        for package in ("dexgrasp", "dexgrasp_env")
        for path in ROOT.glob(f"{package}/*/__init__.py")
    }
    assert [room for room in sorted(rooms) if f"`{room}`" not in page] == []
