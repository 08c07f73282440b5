"""`docs/constants.md` against the code: one table of every number that somebody chose."""

import ast
import importlib
import json
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest
from project_scripts import load_script

from dexgrasp.learning.imitation import taken
from dexgrasp.motion import carrying
from dexgrasp.motion import move_until_contact as guarded
from dexgrasp.planning import constraints
from dexgrasp_env.errors import InputError

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("dexgrasp/planning", "dexgrasp/motion", "dexgrasp/shape", "dexgrasp_env/perception")
SECTION, ROW = re.compile(r"## `(.*\.py)`"), re.compile(r"\| `(\w+)` \| `(.*?)` \|")
PLAIN = re.compile(r"\| `(.*\.py)` \| (.*) \|")


def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def in_code(module: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Yield the constants of a module that hold a number."""
    for statement in module.body:
        if not isinstance(statement, ast.Assign):
            continue
        (target,), value = statement.targets, statement.value
        several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
        pairs = zip(target.elts, value.elts, strict=True) if several else [(target, value)]
        for name, each in pairs:
            numbers = [
                n for n in ast.walk(each) if isinstance(n, ast.Constant) and type(n.value) in (int, float)
            ]
            if numbers and re.fullmatch(r"_?[A-Z][A-Z0-9_]*", ast.unparse(name)):
                yield ast.unparse(name), each


def in_fields(module: ast.Module) -> dict[str, ast.expr]:
    """Return the defaults of a module's dataclasses."""
    classes = [c for c in module.body if isinstance(c, ast.ClassDef)]
    found = [s for c in classes for s in c.body if isinstance(s, ast.AnnAssign) and s.value]
    return {ast.unparse(s.target): s.value for s in found if s.value}


def table() -> tuple[dict[tuple[str, str], str], set[tuple[str, str]]]:
    """Return the tuned constants with their values, and the others."""
    tuned: dict[tuple[str, str], str] = {}
    plain, file = set(), ""
    for line in (ROOT / "docs/constants.md").read_text().splitlines():
        if found := SECTION.fullmatch(line):
            file = found[1]
        elif found := ROW.match(line):
            tuned[file, found[1]] = found[2]
        elif found := PLAIN.match(line):
            plain |= {(found[1], name) for name in re.findall(r"`(\w+)`", found[2])}
    return tuned, plain


def test_the_table_has_every_constant_once_and_no_other():
    tuned, plain = table()
    paths = [path for room in ROOMS for path in sorted((ROOT / room).glob("*.py"))]
    code = {(str(path.relative_to(ROOT)), name) for path in paths for name, _ in in_code(tree(path))}
    assert not plain & tuned.keys()
    assert sorted(code - plain - tuned.keys()) == []
    settings = {key for key in tuned if key[0] == "dexgrasp/planning/settings.py"}
    assert sorted((plain | tuned.keys()) - settings - code) == []


@pytest.mark.parametrize(("file", "name"), table()[0])
def test_the_table_has_the_value_of_the_code(file, name):
    module = tree(ROOT / file)
    value = (in_fields(module) | dict(in_code(module)))[name]
    assert ast.dump(ast.parse(table()[0][file, name], mode="eval").body) == ast.dump(value)


def test_every_group_is_an_agent_that_can_be_ablated(monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.syspath_prepend(str(ROOT))
    script = importlib.import_module("scripts.ablate_constants")
    from dexgrasp.planning.settings import PlannerSettings

    text = (ROOT / "docs/constants.md").read_text()
    for group, without in script.GROUPS.items():
        assert f"| `{group}` |" in text
        assert without.split(";")[0] in text
        made = script.__dict__[f"no_{group}"]
        changes = getattr(made, "keywords", {}).keys() - {"turns", "regrasps"}
        assert changes <= {field.name for field in fields(PlannerSettings)}


@pytest.fixture
def varying(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return load_script("vary_constants")


def test_constants_are_named_by_file_or_name_and_scenes_are_of_single_objects(varying):
    assert varying.table(("motion",), ("guarded._GAIN",)) == [
        ("dexgrasp/motion/move_until_contact.py", "_GAIN")
    ]
    apart = varying.table(("planning", "shape"), ("_APART",))
    assert {name for _, name in apart} == {"_APART"}
    assert len(apart) > 2
    assert {file for file, _ in varying.table(("shape",), ("around",))} == {"dexgrasp/geometry/around.py"}
    with pytest.raises(InputError, match="no constant 'guarded' in these rooms"):
        varying.table(("shape",), ("guarded",))
    assert len(varying.Vary(out="vary.json").objects) == 20


def test_a_constant_is_changed_wherever_it_holds_and_afterwards_is_what_it_was(varying):
    old = guarded._OVERTRAVEL
    with varying.changed(guarded, "_OVERTRAVEL", 0.5):
        assert guarded._OVERTRAVEL == 0.5
        assert guarded.GuardedGrasp.__init__.__defaults__ == (0.5,)
    assert old == guarded._OVERTRAVEL
    assert guarded.GuardedGrasp.__init__.__defaults__ == (old,)
    with varying.changed(guarded, "TIP_DEPTH", 0.1):
        assert carrying.pressing_torques.__globals__["TIP_DEPTH"] == 0.1
        assert taken.TIP_DEPTH == 0.1
    assert taken.TIP_DEPTH == guarded.TIP_DEPTH > 0.1


def test_what_compiled_code_has_built_in_is_not_varied(varying):
    assert varying.compiled(constraints, "MARGIN_SCALE")
    assert not varying.compiled(guarded, "_OVERTRAVEL")
    assert varying.scaled((3, (0.5, 2.0)), 0.5) == (2, (0.25, 1.0))
    assert varying.scaled(True, 2.0) is varying.scaled("auto", 2.0) is None


def test_heavier_objects_are_borne_by_less_and_a_run_goes_on(varying, tmp_path, monkeypatch, capsys):
    scenes = {
        "constants": ("ASSUMED_DENSITY", "closure_aim"),
        "objects": ("soda",),
        "out": tmp_path / "vary.json",
    }
    asked = varying.Vary(trials=1, **scenes)
    assert asked.run() == 0
    printed = capsys.readouterr().out
    aim, density = map(json.loads, printed.splitlines())
    assert density["x2"]["merit"] < 0.0 < density["x0.5"]["merit"]
    assert density["x2"]["usual"] == [1, 0]
    assert aim["x2"]["scenes"] == 1
    monkeypatch.setattr(varying, "plans", None)
    assert asked.run() == 0
    assert capsys.readouterr().out == printed
    assert varying.Vary(trials=2, **scenes).run() == 2


def test_an_object_among_others_is_no_longer_told_apart_where_patches_reach_too_far(
    varying, tmp_path, capsys
):
    scenes = {"objects": ("soda",), "trials": 1, "protocol": "clutter_dense", "out": tmp_path / "looks.json"}
    constants = "instances._AROUND", "instances._TALL"
    assert varying.Vary(rooms=("perception",), constants=constants, **scenes).run() == 0
    around, tall = map(json.loads, capsys.readouterr().out.splitlines())
    assert around["x2"]["merit"] < -0.3
    assert around["x2"]["usual"] == [1, 0]
    assert tall["x2"]["same"]
