"""The house: rooms stand one above the other, files form no circle, and what is long stays rare."""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FLOORS = (
    "dexgrasp_env", "runs agent", "geometry", "mechanics", "grasp", "motion export viewer", "planning", "registry",
    "evaluation", "data", "learning", "agents", "cli", "__main__",
)  # fmt: skip
"""Rooms from the ground up: a room imports from its own and from those below, whatever stands beside it on a floor."""

FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms.split()}
SKIPPED, PARAMETERS = 200, 9
"""At most: `fmt: skip` in the code, and functions of eight or more parameters."""

LIBRARY = [
    path for room in ("dexgrasp_env", "dexgrasp", "agents") for path in sorted((ROOT / room).rglob("*.py"))
]
CODE = [*LIBRARY, *sorted(ROOT.glob("tests/*.py")), *sorted(ROOT.glob("scripts/*.py"))]


def module_of(path):
    """Return the dotted name of a file; what acts is `dexgrasp.agents`, wherever it lies."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join((("dexgrasp",) if parts[0] == "agents" else ()) + parts).removesuffix(".__init__")


@cache
def imported(path):
    """Return the files of the library that a file imports, anywhere in it."""
    files, here = {module_of(p): p for p in LIBRARY}, module_of(path).split(".")
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = here if path.name == "__init__.py" else here[:-1]
            base = [*above[: len(above) + 1 - node.level], node.module] if node.level else [node.module]
            names |= {".".join(filter(None, [*base, alias.name])) for alias in node.names}
    found = {files.get(name) or files.get(name.rpartition(".")[0]) for name in names}
    return frozenset(found - {None, path})


def room_of(path):
    package, *rest = module_of(path).split(".")
    return package if package == "dexgrasp_env" else (rest or [""])[0]


def test_no_import_runs_upwards():
    for path in LIBRARY:
        for other in imported(path):
            room, used = room_of(path), room_of(other)
            assert room == used or not (room and used) or FLOOR[used] < FLOOR[room], f"{path} imports {other}"


def test_no_files_import_each_other_in_a_circle():
    try:
        TopologicalSorter({path: imported(path) for path in LIBRARY}).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(module_of(path) for path in error.args[1]))


def test_files_and_lines_stay_short():
    lines = {path: path.read_text().splitlines() for path in CODE}
    assert [path for path, own in lines.items() if len(own) > 400] == []
    assert [
        f"{path}:{n}" for path, own in lines.items() for n, line in enumerate(own, 1) if len(line) > 120
    ] == []
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("assets/**/*.md")]
    prose = [
        (path, line) for path in pages for line in path.read_text().splitlines() if not line.startswith("|")
    ]
    assert [found for found in prose if len(found[1]) > 120] == []
    assert sum("# fmt: skip" in line for own in lines.values() for line in own) <= SKIPPED


def test_functions_of_many_parameters_are_few():
    found = []
    for path in LIBRARY:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
                found += [f"{path}: {node.name}"] * (len(set(names) - {"self", "cls"}) >= 8)
    assert len(found) <= PARAMETERS, found


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
