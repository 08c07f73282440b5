"""Seasons: seeds that only a release gives, one scoring, trials published, pages written from them."""

import gzip
import json
from datetime import UTC, datetime

import pytest
from project_scripts import load_script
from refusals import refused
from tables import table

beacon, commitment, pages, season = map(
    load_script, ("beacon", "season_commitment", "season_pages", "season")
)

ENTRY = table("season_entry")
ROUND = 657413
SIGNATURE = "b713718a38ae728dfd477991af2822e08d2f305e47718cef9f7848ce4050e7be41076862b98fad56e91a6b85b89cd97b"
"""Of that round, as published."""
BEFORE = datetime(2023, 9, 1, tzinfo=UTC)


@pytest.fixture
def house(tmp_path):
    """A folder with a season, and the repository's code."""
    path = tmp_path / "seasons" / "2027-01.json"
    path.parent.mkdir()
    path.write_text(json.dumps({"schema": 2, "entries": {"small": ENTRY}}))
    return tmp_path, path


def test_a_signature_is_checked_without_a_network():
    assert beacon.randomness(ROUND, SIGNATURE).startswith("fc1873a13f3545aeade84015")
    for number, signature in (
        (ROUND + 1, SIGNATURE),
        (ROUND, SIGNATURE[:-1] + "c"),
        (ROUND, "b7"),
        (ROUND, "x"),
    ):
        with refused("not the signature of round"):
            beacon.randomness(number, signature)
    assert f"{beacon.round_time(ROUND):%Y-%m-%d}" == "2023-09-15"


def test_a_commitment_is_one_and_ahead_of_its_round(house):
    _, path = house
    with refused(r"round 657413 was 2023-09-15 .* lies ahead"):
        commitment.commit(path, ROUND, datetime(2026, 11, 29, tzinfo=UTC))
    commitment.commit(path, ROUND, BEFORE)
    with refused("needs --again REASON"):
        commitment.commit(path, ROUND + 1, BEFORE)
    again = commitment.commit(path, ROUND + 1, BEFORE, "a typing error")
    assert json.loads(again.read_text())["again"] == ["a typing error"]


def test_seeds_follow_from_commitment_and_beacon(house):
    _, path = house
    commitment.commit(path, ROUND, BEFORE)
    found = commitment.read_season(path)
    first = [seed for _, seed in found.seeds("ab").values()]
    assert first == [seed for _, seed in found.seeds("ab").values()]
    assert len(set(first)) == 2
    assert all(0 <= seed < 2**31 for seed in first)
    assert not set(first) & {seed for _, seed in found.seeds("ac").values()}
    commitment.commit(path, ROUND, BEFORE, "another")
    assert not set(first) & {seed for _, seed in found.seeds("ab").values()}


def test_nothing_is_scored_but_what_was_committed_to(house):
    root, path = house
    with refused("commit to it first"):
        season.play(path, 1, SIGNATURE, root=root)
    mesh = root / "a.obj"
    mesh.write_text("v 0 0 0\nv .05 0 0\nv 0 .05 0\nv 0 0 .05\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n")
    path.write_text(json.dumps({"schema": 2, "entries": {"small": {**ENTRY, "objects": [str(mesh)]}}}))
    commitment.commit(path, ROUND, BEFORE)
    with refused(r"give --signature HEX of round 657413, of 2023-09-15"):
        season.play(path, 1, root=root)
    mesh.write_text(mesh.read_text().replace(".05", ".06"))
    with refused("files of small is not as"):
        season.play(path, 1, SIGNATURE, root=root)
    path.write_text(path.read_text().replace('"trials": 1', '"trials": 2'))
    with refused("is not as"):
        season.play(path, 1, SIGNATURE, root=root)
    assert not (root / "docs").exists()


def test_a_season_is_played_once_shown_by_its_trials_and_verified(house):
    root, path = house
    commitment.commit(path, ROUND, BEFORE)
    out = season.play(path, 1, SIGNATURE, root=root)
    page = (
        "<!-- results:2027-01/small -->\n<!-- /results:2027-01/small -->\n"
        "<!-- rate:2027-01/small random lift --><!-- /rate -->"
    )
    shown = pages.rewritten(page, root)
    assert "| 2 | 0.0 [0, 66] |" in shown
    assert "0.0 % [0, 66], 0 of 2<!-- /rate -->" in shown
    assert "python scripts/season.py show 2027-01/small" in shown
    found = list(season.verify(commitment.read_season(path), 2, 0, root))
    assert [right for right, _ in found] == [True] * 4
    with refused("needs --again REASON"):
        season.play(path, 1, SIGNATURE, root=root)
    rows = gzip.decompress((out / "small-0" / "trials.jsonl.gz").read_bytes()).replace(
        b'"success": false', b'"success": true'
    )
    (out / "small-0" / "trials.jsonl.gz").write_bytes(gzip.compress(rows))
    wrong = [words for right, words in season.verify(commitment.read_season(path), 2, 0, root) if not right]
    assert len(wrong) == 1
    assert "other success" in wrong[0]
    season.play(path, 1, SIGNATURE, again="to see the bits", root=root)
    record = json.loads((out / "season.json").read_text())["scorings"]
    assert [scoring["again"] for scoring in record] == [None, "to see the bits"]


def test_without_a_beacon_entropy_is_entered_and_recorded_as_unchecked(house):
    root, path = house
    commitment.commit(path, None, BEFORE)
    with refused("give --entropy WORDS"):
        season.play(path, 1, SIGNATURE, root=root)
    drawn = commitment.entropy_of(None, None, "the lottery of 2 January")
    assert drawn == ("the lottery of 2 January", {"entropy": "the lottery of 2 January", "checked": False})


def test_what_was_interrupted_goes_on(house):
    root, path = house
    commitment.commit(path, ROUND, BEFORE)
    found = commitment.read_season(path)
    record = season.Record(found, root / "docs" / "results")
    assert record.begin({"signature": "c"}, None) == 1
    again = season.Record(found, root / "docs" / "results")
    assert again.begin({"signature": "c"}, None) == 1
    assert len(again.scorings) == 1
    with refused("second scoring"):
        season.Record(found, root / "docs" / "results").begin({"signature": "d"}, None)


def test_every_page_shows_what_was_published():
    shown = set()
    for path in pages.pages():
        text = path.read_text()
        shown |= {found["name"] for found in pages._MARKS.finditer(text)}
        assert pages.rewritten(text) == text, f"{path.name}: run scripts/season.py write"
    newest = max((pages.ROOT / "docs" / "results").iterdir())
    entries = {run.parent.name.rpartition("-")[0] for run in newest.glob("*/run.json")}
    assert {f"{newest.name}/{entry}" for entry in entries} <= shown
