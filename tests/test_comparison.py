"""`dexgrasp compare`: paired comparison of two agents of an evaluation."""

import pytest
from processes import typed
from refusals import refused
from tables import mistakes
from trial_rows import row, write_run

from dexgrasp.evaluation.comparison import compare_rows


@pytest.fixture
def folder(tmp_path):
    rows = [row("x", "pear", k, True) for k in range(8)] + [row("y", "pear", k, k < 2) for k in range(9)]
    rows += [row(a, "lego", 0, a == "y") for a in "xy"]
    return write_run(tmp_path, rows)


def test_compare_counts_only_scenes_that_both_met(folder, printed):
    assert typed(f"compare {folder} x y --json") == 0
    found = printed()
    assert [found[k] for k in ("scenes", "both", "only_a", "only_b", "neither")] == [9, 2, 6, 1, 0]
    assert found["p_value"] == pytest.approx(0.1, abs=0.1)
    assert found["by_object"]["pear"]["difference"] == pytest.approx(0.75)
    assert found["difference"] == pytest.approx(5 / 9)
    assert found["ci95"][0] < 5 / 9 < found["ci95"][1]
    assert {d["solved_by"] for d in found["discordant"] if d["object"] == "lego"} == {"y"}
    assert len(found["discordant"]) == 7
    assert "by_protocol" not in found


def test_other_scene_seeds_and_protocols_are_other_scenes():
    a = [row("x", "pear", 0, True), row("x", "pear", 1, True, protocol="heavy")]
    b = [row("y", "pear", 0, False) | {"scene_seed": 5}, row("y", "pear", 1, False, protocol="lift")]
    assert compare_rows(a + b, "x", "y")["scenes"] == 0
    both = [row(n, "pear", 0, True, protocol=p) for n in "xy" for p in ("heavy", "lift")]
    assert set(compare_rows(both, "x", "y")["by_protocol"]) == {"heavy", "lift"}


def test_a_scene_under_many_conditions_is_one_scene():
    """One scene that one agent fails under six conditions is no evidence of six."""
    parts = ("lift", "upright", "heavy", "shaken", "pushed@0.5", "slippery@0.5")
    rows = [row(n, "pear", k, n == "x" or k > 0, protocol=p) for n in "xy" for k in range(20) for p in parts]
    found = compare_rows(rows, "x", "y")
    assert (found["trials"], found["scenes"], found["only_a"]) == (120, 20, 6)
    assert found["p_value"] > 0.3
    assert found["ci95"][0] < 0.0 < found["difference"] == pytest.approx(0.05)
    alone = compare_rows([own for own in rows if own["protocol"] == "lift"], "x", "y")
    assert found["ci95"] == pytest.approx(alone["ci95"], abs=0.01)


def test_scenes_of_other_settings_are_not_compared():
    rows = [row(n, "pear", 0, env={"friction": mu, "obs_mode": n}) for n, mu in (("x", 0.7), ("y", 0.7))]
    assert compare_rows(rows, "x", "y")["scenes"] == 1
    rows[1]["env"]["friction"] = 0.3
    assert compare_rows(rows, "x", "y")["scenes"] == 0
    assert compare_rows(rows, "x", "y", alike=False)["scenes"] == 1


def test_an_agent_in_two_folders_is_refused_where_they_differ():
    rows = [row("x", "pear", 0, True), row("y", "pear", 0, True), row("y", "pear", 0, True)]
    assert compare_rows(rows, "x", "y")["trials"] == 1
    rows[2]["success"] = False
    with refused("y met pear, trial 0, twice"):
        compare_rows(rows, "x", "y")


def test_an_agent_is_compared_with_itself_under_another_protocol(tmp_path, printed):
    rows = [
        row("x", "pear", k, k < n, protocol=p) for p, n in (("lift", 3), ("lift@warp", 4)) for k in range(4)
    ]
    assert typed(f"compare {write_run(tmp_path, rows)} x x --protocols lift lift@warp --json") == 0
    found = printed()
    assert (found["a"], found["b"]) == ("x (lift)", "x (lift@warp)")
    assert [found[k] for k in ("scenes", "both", "only_a", "only_b")] == [4, 3, 0, 1]


def test_table_and_mistakes(folder, capsys):
    assert typed(f"compare {folder} x y") == 0
    out = capsys.readouterr().out
    assert "+75.0" in out
    assert "dropped" in out
    for arguments, words in mistakes("comparisons"):
        assert typed(f"compare {folder}{arguments}") == 2
        assert words in capsys.readouterr().err
