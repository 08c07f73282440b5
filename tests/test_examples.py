"""The examples run, each in a folder and a process of its own, and use what the page of the public API names."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from processes import typed

ROOT = Path(__file__).parents[1]
OTHERS = sorted((ROOT / "examples" / "agents_of_others").glob("*.py"))
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(example, tmp_path):
    few = ["--episodes", "4", "--every", "2", "--trials", "2"] if example.stem.startswith("train_") else []
    done = subprocess.run([sys.executable, example, *few], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout
    assert "Traceback" not in done.stderr
    assert not any("__main__" in record.read_text() for record in tmp_path.rglob("*.json"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_of_the_public_api(example):
    text = example.read_text()
    page = (ROOT / "docs" / "public-api.md").read_text()
    assert len(text.splitlines()) < (100 if example.stem.startswith("train_") else 60)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("dexgrasp"):
            assert all(
                re.search(rf"`(?:{node.module}\.|[\w(), ]*){alias.name}\b", page) for alias in node.names
            )


@pytest.mark.slow
def test_the_notebook_runs_top_to_bottom(tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    book = nbformat.read(ROOT / "examples" / "first_steps.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in book.cells)  # kept without: they differ by machine
    nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    said = "".join(part.get("text", "") for cell in book.cells for part in cell.get("outputs", ()))
    assert "lifted and held: True" in said
    assert "hardcoded 2 of 2" in said
    pictures = [
        part for cell in book.cells for part in cell.get("outputs", ()) if "image/png" in part.get("data", {})
    ]
    assert len(pictures) == 2


def test_there_are_ten_to_twenty_and_trainings_and_their_list_has_each():
    page = (ROOT / "examples" / "README.md").read_text()
    assert 10 <= sum(not path.stem.startswith("train_") for path in EXAMPLES) <= 20
    listed = re.findall(r"\]\(([\w/]+\.py)\)", page)
    assert sorted(listed) == sorted(str(path.relative_to(ROOT / "examples")) for path in EXAMPLES + OTHERS)


def test_an_agent_by_others_recipes_lifts(tmp_path, monkeypatch, printed):
    monkeypatch.chdir(ROOT)
    agent = "examples.agents_of_others.antipodal:Antipodal"
    what = f"evaluate --agents {agent} --robot panda_gripper --objects soda --trials 1 --json --out {tmp_path}/run"
    assert typed(what) == 0
    assert printed()["agents"][agent]["successes"] == 1
