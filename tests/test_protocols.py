"""Protocols: what they are made of, their scenes, and how parts are counted together."""

import gymnasium as gym
import pytest
from processes import typed
from refusals import refused
from trial_rows import row as trial_row

import dexgrasp_env  # noqa: F401
from dexgrasp.evaluation.protocol import (
    GROUPS,
    PROTOCOLS,
    SHOWN,
    agent_settings,
    parts,
    protocol_names,
)
from dexgrasp.evaluation.settings import EvaluationSettings, TrialSpec
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.evaluation.summary import judged, protocol_counts
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.registry import make_agent


def row(protocol, success, trial=0, agent="a"):
    return trial_row(agent, "pear", trial, success, protocol=protocol)


def test_robust_is_all_eight_and_their_parts():
    assert len(GROUPS["robust"]) == 8
    assert {*parts("robust")} <= set(PROTOCOLS)
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
    assert [counts["slippery"][key] for key in ("trials", "successes")] == [8, 4]
    (low, high), rate = counts["robust"]["ci95"], counts["robust"]["rate"]
    assert low < rate < high
    assert rate == pytest.approx((7 * 0.75 + 0.5) / 8)
    assert "robust" not in protocol_counts({"lift": rows["lift"]})


def test_figures_are_published_with_protocols_and_listed(printed):
    published = {name for name, protocol in PROTOCOLS.items() if protocol.figures}
    assert {"lift", "varied", "moved@8", "belt@5", "kitchen", "gripper", "outside_one_view"} <= published
    for figure in (figure for name in published for figure in PROTOCOLS[name].figures):
        assert all(0 <= count <= figure.trials for count in figure.agents.values())
        assert {*figure.agents} <= {name for names in SHOWN.values() for name in names}
        assert figure.command.startswith(("dexgrasp evaluate ", "python scripts/season.py "))
    assert PROTOCOLS["lift"].shown("learned") == "bc_cloud 120 of 120 held"
    assert typed("list protocols --json") == 0
    rows = {row["name"]: row for row in printed()["protocols"]}
    assert rows["clutter_heap@mask"]["planner"] == "bilevel 17 of 60 clean"


def test_the_constant_acts_as_the_environment_does_where_actions_are_whole_grasps():
    agent = make_agent("constant")
    modes = {
        name: agent_settings("constant", agent, gym.spec(PROTOCOLS[name].env_id).kwargs)["control_mode"]
        for name in ("lift", "varied")
    }
    assert modes == {"lift": "grasp_once", "varied": "table_grasp_once"}


def test_floors_are_printed(capsys, tmp_path):
    assert PROTOCOLS["place"].floor_line == ""
    assert typed(f"evaluate --agents constant --objects sugar_box --trials 1 --out {tmp_path}") == 0
    told = capsys.readouterr().out
    assert PROTOCOLS["lift"].floor_line in told
    assert "floor of lift on all20: constant" in told
