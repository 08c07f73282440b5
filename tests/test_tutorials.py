"""The tutorials of the site do what they say: every block is run, in order, in a folder of its own."""

import re
import shlex
import sys
from pathlib import Path

import pytest

from agents.cli.commands import run_command

TUTORIALS = sorted((Path(__file__).parents[1] / "docs" / "tutorials").glob("*.md"))
FENCE = re.compile(
    r"^```(?:\{code-block\} )?(\w+)\n(?::caption: (\S+)\n\n)?(.*?)^```$", re.MULTILINE | re.DOTALL
)


def blocks(page):
    """Language, name of the file that it is to be kept as or None, and text of each block."""
    return [(language, name or None, text) for language, name, text in FENCE.findall(page.read_text())]


def run_commands(text):
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(re.sub(r"(^|\s)#.*", "", line))
        assert words[:1] in ([], ["dexgrasp"]), f"a tutorial's bash block runs dexgrasp alone, not {line!r}"
        if words:
            assert run_command(words[1:]) == 0, line


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_runs_from_top_to_bottom(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    namespace = {"__name__": "tutorial"}
    for language, name, text in blocks(page):
        if name:
            (tmp_path / name).write_text(text)
        elif language == "python":
            exec(compile(text, str(page), "exec"), namespace)
        elif language == "bash":
            run_commands(text)
        else:
            pytest.fail(f"{page.name}: nobody runs a block of {language}")
    for module in {Path(name).stem for _, name, _ in blocks(page) if name}:
        sys.modules.pop(module, None)


def test_the_five_tutorials_are_there():
    assert [page.stem for page in TUTORIALS] == [
        "extend",
        "own-cloud",
        "own-mesh",
        "own-policy",
        "read-results",
    ]
    assert all(len(blocks(page)) >= 5 for page in TUTORIALS)
