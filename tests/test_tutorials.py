"""The tutorials of the site do what they say: every block is run, in order, in a folder of its own."""

import shlex
import sys
from pathlib import Path

import pytest
from project_scripts import load_script

from dexgrasp.cli.commands import run_command

ROOT = Path(__file__).parents[1]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))


walk = load_script("walk")


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_runs_from_top_to_bottom(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    namespace = {"__name__": "tutorial"}
    for language, name, text in walk.blocks(page):
        if name:
            (tmp_path / name).write_text(text)
        elif language == "python":
            exec(compile(text, str(page), "exec"), namespace)
        else:
            assert language == "bash", "nobody runs other blocks"
            for line in walk.commands(text):
                program, *words = shlex.split(line)
                assert program == "dexgrasp"
                assert run_command(words) == 0, line
    for _, name, _ in walk.blocks(page):
        sys.modules.pop(Path(name).stem, None)


def test_the_five_tutorials_are_there():
    assert [page.stem for page in TUTORIALS] == [
        "extend",
        "own-cloud",
        "own-mesh",
        "own-policy",
        "read-results",
    ]
    assert all(len(walk.blocks(page)) >= 5 for page in TUTORIALS)


def test_a_walk_stops_where_a_command_fails(tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text("```python\nprint(6 * 7)\n```\n\n```bash\nfalse   # no\necho never\n```\n")
    assert not walk.walk(page, tmp_path)
    said = capsys.readouterr().out
    assert "42" in said
    assert "$ false" in said
    assert "never" not in said


PAGE = (
    '<html><head><link rel="stylesheet" href="{0}"><link rel="canonical" href="https://x.org/"></head>'
    "<body>{1}</body></html>"
)


@pytest.mark.parametrize(
    ("style", "body", "fault"),
    [
        ("own.css", '<a href="https://x.org">x</a><img src="data:image/png;base64,AA==">', None),
        ("https://x.org/own.css", "", "from outside"),
        ("own.css", '<script src="//x.org/a.js"></script>', "from outside"),
        ("own.css", '<style>@import "https://x.org/a.css";</style>', "from outside"),
        ("own.css", '<a href="gone.html#part">x</a>', "leads nowhere"),
    ],
)
def test_what_a_page_loads_from_outside_is_found(style, body, fault, tmp_path):
    (tmp_path / "own.css").write_text("body { color: black }")
    (tmp_path / "index.html").write_text(PAGE.format(style, body))
    found = load_script("check_site").faults(tmp_path)
    assert [fault in line for line in found] == ([] if fault is None else [True])
