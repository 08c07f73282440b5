"""Seasons: seeds that only a release gives, one scoring, trials published, pages written from them."""

import dataclasses
import json
import subprocess

import pytest
from project_scripts import load_script

from dexgrasp_env.errors import InputError

season = load_script("season")

ENTRY = {
    "agents": ["random"],
    "objects": ["mask"],
    "protocols": ["lift"],
    "trials": 1,
    "seeds": 2,
    "title": "Two.",
}


def git(root, *words):
    who = ("-c", "user.name=a", "-c", "user.email=a@b.c")
    subprocess.run(["git", "-C", str(root), *who, *words], check=True, capture_output=True)


@pytest.fixture
def house(tmp_path):
    """A repository with a little code, a season and a tagged release."""
    (tmp_path / "agents").mkdir()
    (tmp_path / "agents" / "random.py").write_text("")
    path = tmp_path / "seasons" / "2026-12.json"
    path.parent.mkdir()
    path.write_text(json.dumps({"schema": 1, "release": "v1", "entries": {"small": ENTRY}}))
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "one")
    git(tmp_path, "tag", "v1")
    return tmp_path, path


def seeds(root, path):
    found = season.read_season(path)
    return [settings.seed for _, settings in found.scorings(season.released(found, path, root))]


def test_seeds_follow_from_release_and_file(house):
    root, path = house
    first = seeds(root, path)
    assert first == seeds(root, path)
    assert len(set(first)) == 2
    assert all(0 <= seed < 2**31 for seed in first)
    path.write_text(path.read_text() + "\n")
    git(root, "commit", "-qam", "another file")
    git(root, "tag", "-f", "v1")
    assert not set(first) & set(seeds(root, path))


def test_nothing_is_scored_but_what_was_released(house):
    root, path = house
    (root / "agents" / "another.py").write_text("")
    with pytest.raises(InputError, match=r"agents/another\.py is not as it was released"):
        season.run(path, 1, root=root)
    (root / "agents" / "another.py").unlink()
    path.write_text(path.read_text().replace('"trials": 1', '"trials": 2'))
    with pytest.raises(InputError, match=r"2026-12\.json is not as it was released"):
        season.run(path, 1, root=root)
    git(root, "tag", "-d", "v1")
    with pytest.raises(InputError, match="no such tag"):
        season.run(path, 1, root=root)
    assert not (root / "docs").exists()


def test_a_season_is_scored_once_and_pages_show_its_trials(house):
    root, path = house
    out = season.run(path, 1, root=root)
    page = (
        "<!-- results:2026-12/small -->\n<!-- /results:2026-12/small -->\n"
        "<!-- rate:2026-12/small random lift --><!-- /rate -->"
    )
    shown = season.rewritten(page, root)
    assert "| 2 | 0.0 [0, 66] |" in shown
    assert "0 of 2, 0.0 % [0, 66]<!-- /rate -->" in shown
    assert "python scripts/season.py run seasons/2026-12.json" in shown
    with pytest.raises(InputError, match="needs --again REASON"):
        season.run(path, 1, root=root)
    before = (out / "small-0" / "trials.jsonl.gz").read_bytes()
    season.run(path, 1, "to see the bits", root)
    assert [scoring["again"] for scoring in json.loads((out / "season.json").read_text())["scorings"]] == [
        None,
        "to see the bits",
    ]
    rows = [
        json.loads(line)
        for data in (before, (out / "small-0" / "trials.jsonl.gz").read_bytes())
        for line in season.gzip.decompress(data).splitlines()
    ]
    assert rows[0]["scene_seed"] == rows[1]["scene_seed"]
    assert rows[0]["height"] == rows[1]["height"]


def test_pages_show_the_evaluations_that_the_season_names(tmp_path):
    known = season.Season("2026-12", "v1", {"small": {"seeds": 2}, "small-view": {}}, "")
    for name in ("small-0", "small-1", "small-view-0"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").touch()
    found = season.published(tmp_path, known, "small")
    assert [path.name for path in found] == ["small-0", "small-1"]
    with pytest.raises(InputError, match="unknown entry"):
        season.published(tmp_path, known, "large")
    more = dataclasses.replace(known, entries={"small": {"seeds": 3}, "small-view": {}})
    with pytest.raises(InputError, match="small-2 is not there"):
        season.published(tmp_path, more, "small")
    fewer = dataclasses.replace(known, entries={"small": {"seeds": 1}, "small-view": {}})
    with pytest.raises(InputError, match="small-1 is no evaluation of season 2026-12: remove it"):
        season.published(tmp_path, fewer, "small")


def test_what_was_interrupted_goes_on(house):
    root, path = house
    found = season.read_season(path)
    record = season.Record(found, root / "docs" / "results")
    assert record.begin("c" * 40, None) == 1
    again = season.Record(found, root / "docs" / "results")
    assert again.begin("c" * 40, None) == 1
    assert len(again.scorings) == 1
    with pytest.raises(InputError, match="second scoring"):
        season.Record(found, root / "docs" / "results").begin("d" * 40, None)


def test_every_page_shows_what_was_published():
    shown = set()
    for path in season.pages():
        text = path.read_text()
        shown |= {found["name"] for found in season._MARKS.finditer(text)}
        assert season.rewritten(text) == text, f"{path.name}: run scripts/season.py write"
    runs = (season.ROOT / "docs" / "results").glob("*/*/run.json")
    assert shown == {f"{run.parents[1].name}/{run.parent.name.rpartition('-')[0]}" for run in runs}


def test_a_file_that_is_no_season_is_refused(tmp_path):
    path = tmp_path / "a.json"
    for content in ("{}", '{"schema": 1, "release": "v1", "entries": []}', '{"schema": 2}'):
        path.write_text(content)
        with pytest.raises(InputError, match="is no season"):
            season.read_season(path)
