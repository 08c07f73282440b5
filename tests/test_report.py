"""`dexgrasp report`: one page that needs no other file, markdown that says the same."""

import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from processes import typed
from tables import mistakes
from trial_rows import row as trial_row
from trial_rows import write_run

from dexgrasp.evaluation.report.build import write_report
from dexgrasp.evaluation.report.figures import success
from dexgrasp.evaluation.report.origin import commands, describe_run
from dexgrasp_env.objects.catalogue import OBJECT_SETS

VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """Notes tags that do not close, and everything that would be fetched."""

    def __init__(self):
        super().__init__()
        self.open, self.wrong, self.fetched, self.text = [], [], [], ""

    def handle_starttag(self, tag, attrs):
        self.fetched += [value for name, value in attrs if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)

    def handle_data(self, data):
        self.text += data


def parsed(text):
    page = Page()
    page.feed(text)
    assert page.open == page.wrong == []
    return page


def row(agent, target, trial, success, protocol):
    stages = {"stage_seconds": {"cvae": 0.04, "ik": 0.02, "bilevel": 0.4 + 0.1 * trial}}
    return trial_row(
        agent, target, trial, success, protocol=protocol, reason=None if success else "not_lifted",
        details=stages if agent == "bilevel" else {},
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    rows = [
        row(agent, target, k, agent == "bilevel" or k > 0, protocol)
        for agent in ("bilevel", "hardcoded")
        for target in (*OBJECT_SETS["seen"], "my_mesh")
        for k in range(3)
        for protocol in ("lift", "heavy")
    ]
    return write_run(
        tmp_path, rows, agents=["bilevel", "hardcoded"], objects=list(OBJECT_SETS["seen"]), trials=3, seed=0,
        protocol="lift+heavy", versions={"mujoco": "3.17.0"}, friction=0.5,
    )  # fmt: skip


def test_one_page_that_needs_no_other_file(folder):
    markdown = write_report([folder], folder / "out")
    page = parsed((folder / "out" / "report.html").read_text())
    assert page.fetched
    assert all(address.startswith("data:image/svg+xml;base64,") for address in page.fetched)
    for address in page.fetched:
        drawing = base64.b64decode(address.partition(",")[2]).decode()
        assert "<svg" in drawing
        assert not re.search(r'(href|src)="(?!#)', drawing)
    for words in ("the object was touched and not lifted", "By protocol", "heavy", "Table 6", "94.4 % 17/18", "my_mesh",
                  "dexgrasp replay", "mujoco 3.17.0", "95 % over objects"):  # fmt: skip
        assert words in page.text, words
        assert words in markdown, words
    write_report([folder], folder / "again")  # the same trials make the same page
    assert (folder / "again" / "report.html").read_bytes() == (folder / "out" / "report.html").read_bytes()
    hardcoded = markdown.partition("Planning time, s, hardcoded")[2].partition("###")[0].partition("!")[0]
    assert "14.40" not in hardcoded  # the paper's times stand beside its planner alone
    assert "14.40" in markdown
    assert sorted(p.name for p in (folder / "out").iterdir()) == [
        "planning_times.png", "report.html", "report.md", "success_by_object.png", "success_by_protocol.png",
        "success_by_set.png",
    ]  # fmt: skip


def test_plots_have_the_intervals_of_the_tables():
    cell = {"trials": 4, "successes": 2, "rate": 0.5, "ci95": (0.1, 0.9), "by_set": {}}
    assert success("by_set", "set", {"a": cell}, ["all"]).agents["a"]["all"] == [50.0, 10.0, 90.0]


def test_commands_are_those_that_made_it(folder):
    line = commands(folder)[0]
    assert "--agents bilevel hardcoded --objects seen --trials 3 --seed 0 --protocol lift heavy" in line
    assert "--friction 0.5" in line
    assert "--robot" not in line
    run = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(
        json.dumps(run | {"cell": "our lab-8b8c9eba", "robot": "/x/our lab.yaml"})
    )
    assert "--robot '/x/our lab.yaml'" in commands(folder)[0]
    assert "in our lab-8b8c9eba" in describe_run(folder)


@pytest.mark.parametrize("wrong", mistakes("settings_of_runs"), ids=str)
def test_settings_that_no_evaluation_writes_are_unknown(folder, wrong):
    run = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(run | wrong))
    assert describe_run(folder) == f"{folder.name}: settings unknown"
    assert commands(folder) == [f"dexgrasp report {folder}"]


def test_the_command_escapes_names(folder, printed):
    lines = (folder / "trials.jsonl").read_text().replace("my_mesh", r"<script>alert(1)</script>a|b\udcff")
    (folder / "trials.jsonl").write_text(lines)
    assert typed(f"report {folder} --json") == 0
    found = printed()
    assert "<script>alert(1)</script>a\\|b?" in Path(found["report"]).read_text()
    assert "<script>alert(1)</script>a|b?" in parsed(Path(found["html"]).read_text()).text
