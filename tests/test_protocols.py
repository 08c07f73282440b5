"""Protocols: what they are made of, their scenes, and how parts are counted together."""

import pytest
from refusals import refused
from trial_rows import row as trial_row

import dexgrasp_env  # noqa: F401
from dexgrasp.cli.main import main
from dexgrasp.evaluation.protocol import GROUPS, PROTOCOLS, parts, protocol_names
from dexgrasp.evaluation.settings import EvaluationSettings, TrialSpec
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.evaluation.summary import judged, protocol_counts
from dexgrasp.evaluation.trial_runner import TrialRunner


def row(protocol, success, trial=0, agent="a"):
    return trial_row(agent, "pear", trial, success, protocol=protocol)


def test_robust_is_all_eight_and_their_parts():
    assert len(GROUPS["robust"]) == 8
    clutter = {name for name in PROTOCOLS if name.startswith("clutter_")}
    assert len(clutter) == 16
    numbered = {"gentle@8", "clear@8", "clear@15"}
    assert {
        *parts("robust"),
        "presented",
        "varied",
        "realistic",
        "place",
        "lift@warp",
        *clutter,
        *numbered,
    } == set(PROTOCOLS)
    assert parts("slippery") == GROUPS["slippery"]
    assert parts("lift") == ("lift",)
    assert EvaluationSettings.of(["random"], ["pear"], protocols=("robust", "lift")).parts == parts("robust")


def test_an_unknown_name_lists_the_valid_ones():
    with refused("robust"):
        parts("v9")
    assert "pushed@1" in protocol_names()


@pytest.mark.parametrize("name", [name for name in PROTOCOLS if name != "lift@warp"])  # an extra of its own
def test_every_protocol_makes_its_environment(name):
    agent = ("random", "hardcoded")[list(PROTOCOLS).index(name) % 2]  # by the state, by clouds
    settings = EvaluationSettings.of([agent], ["gelatin_box"], protocols=(name,))
    env = TrialRunner(settings).make_env(TrialSpec(agent, "gelatin_box", "gelatin_box", 0, name))
    steps = env.unwrapped.disturbance_steps
    # Time to take away what is in the way, or everything.
    own = {"clear@8": 3200, "clear@15": 6000}.get(
        name, 1800 if "heap" in name else 600 if "clutter" in name else 300
    )
    assert env.spec.max_episode_steps == own + steps
    assert steps == {"pushed@0.5": 80, "pushed@1": 80, "shaken": 40}.get(name, 0)
    env.close()


def test_a_push_counts_only_where_the_weaker_one_was_borne():
    rows = [
        row("pushed@0.5", False),
        row("pushed@1", True),
        row("pushed@0.5", True, 1),
        row("pushed@1", True, 1),
    ]
    rows += [row("pushed@1", True, 0, "b"), row("pushed@0.5", True, 0, "b")]
    assert [r["success"] for r in judged(rows)] == [False, False, True, True, True, True]
    assert judged(rows)[1]["reason"] == "failed_pushed@0.5"


def test_a_group_is_the_mean_of_its_parts():
    rows = {name: [row(name, k < 3, k) for k in range(4)] for name in PROTOCOLS}
    rows["slippery@0.35"] = [row("slippery@0.35", k < 1, k) for k in range(4)]
    counts = protocol_counts(rows)
    assert counts["lift"] == {"trials": 4, "successes": 3, "rate": 0.75, "ci95": list(wilson_interval(3, 4))}
    assert counts["slippery"]["rate"] == pytest.approx(0.5)
    assert (counts["slippery"]["trials"], counts["slippery"]["successes"]) == (8, 4)
    assert counts["robust"]["rate"] == pytest.approx((7 * 0.75 + 0.5) / 8)
    low, high = counts["robust"]["ci95"]
    assert low < counts["robust"]["rate"] < high
    assert "robust" not in protocol_counts({"lift": rows["lift"]})


def test_floors_are_published_with_protocols_and_printed(capsys, tmp_path):
    floors = {name: protocol.floor for name, protocol in PROTOCOLS.items() if protocol.floor}
    assert {"lift", "varied"} <= set(floors)
    for floor in floors.values():
        assert 0 <= min(floor["constant"], floor["hardcoded"]) <= floor["trials"]
    assert PROTOCOLS["place"].floor_line == ""
    asked = [
        "evaluate",
        "--agents",
        "constant",
        "--objects",
        "sugar_box",
        "--trials",
        "1",
        "--out",
        str(tmp_path),
    ]
    assert main(asked) == 0
    told = capsys.readouterr().out
    assert PROTOCOLS["lift"].floor_line in told
    assert "floor of lift on all20: constant" in told
