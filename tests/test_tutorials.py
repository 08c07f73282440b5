"""The tutorials of the site do what they say: every block is run, in order, in a folder of its own."""

import re
import shlex
import sys
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import pytest
from project_scripts import load_script
from tables import mistakes

from dexgrasp.cli.commands import run_command
from dexgrasp.evaluation.protocol import PROTOCOLS

ROOT = Path(__file__).parents[1]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))


FENCE = re.compile(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
"""A fenced block; the word after its language is the file that it is kept as."""


class Block(NamedTuple):
    """A block of a page: its language, the file that it is to be kept as (or nothing), its text."""

    language: str
    name: str
    text: str


def blocks(page: Path) -> list[Block]:
    """Return the fenced blocks of a page, in order."""
    return [Block(*found) for found in FENCE.findall(page.read_text())]


def commands(text: str) -> list[str]:
    """Return the command lines of a block of bash, comments apart."""
    lines = (re.sub(r"(^|\s)#.*", "", line).strip() for line in text.replace("\\\n", " ").splitlines())
    return [line for line in lines if line]


@pytest.mark.slow
@patch.dict(PROTOCOLS)  # a tutorial adds one
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
        else:
            assert language == "bash", "nobody runs other blocks"
            for line in commands(text):
                program, *words = shlex.split(line)
                assert program == "dexgrasp"
                assert run_command(words) == 0, line
    for _, name, _ in blocks(page):
        sys.modules.pop(Path(name).stem, None)


PAGE = (
    '<html><head><link rel="stylesheet" href="{0}"><link rel="canonical" href="https://x.org/"></head>'
    "<body>{1}</body></html>"
)


@pytest.mark.parametrize(("style", "body", "fault"), mistakes("pages"))
def test_what_a_page_loads_from_outside_is_found(style, body, fault, tmp_path):
    (tmp_path / "own.css").write_text("body { color: black }")
    (tmp_path / "index.html").write_text(PAGE.format(style, body))
    found = load_script("check_site").faults(tmp_path)
    assert [fault in line for line in found] == ([] if fault is None else [True])
