"""Pages name what exists: files, modules, classes."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
FILES = [path.as_posix() for room in ("dexgrasp", "dexgrasp_env", "agents", "examples", "scripts", "tests")
         for path in (ROOT / room).rglob("*.py")]  # fmt: skip
OF_USERS = {"my_policy.py"}
OF_SEASONS = {
    "scripts/fetch_ycb.py",
    "scripts/outside.py",
    "scripts/kitchen.py",
}  # in notes of what was released


def named(name: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:k]))
        except ImportError:
            continue
        for part in parts[k:]:
            found = getattr(found, part, None)
        return found is not None
    return False


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_names_what_exists(page):
    text = page.read_text()
    files = set(re.findall(r"\b((?:\w+/)*\w+\.py)\b", text)) if page.name != "CHANGELOG.md" else set()
    files -= OF_USERS | (OF_SEASONS if page.name == "results.md" else set())
    assert [f for f in files if not any(path.endswith(f"/{f}") for path in FILES)] == []
    dotted = set(re.findall(r"\b(?:dexgrasp|dexgrasp_env)(?:\.[A-Za-z_]\w*)+", text))
    assert [name for name in dotted if not named(name)] == []
