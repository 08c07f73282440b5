"""`docs/constants.md` against the code: one table of every number that somebody chose."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

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
