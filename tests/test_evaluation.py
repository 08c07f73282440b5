"""Evaluation: statistics, seeds, trials with agents that misbehave, resuming, summaries, reports."""

import json
import math
import shutil
import signal
import subprocess
import sys
import time
from typing import ClassVar

import gymnasium as gym
import numpy as np
import pytest

from agents.base import Agent, Report
from agents.evaluation import trial as one_trial
from agents.evaluation.evaluate import evaluate
from agents.evaluation.protocol import agent_settings, get_protocol, trial_seeds
from agents.evaluation.replay import replay
from agents.evaluation.report import paper
from agents.evaluation.report.build import write_report
from agents.evaluation.report.tables import render_summary
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.spec import TrialSpec, object_labels, plan_trials
from agents.evaluation.statistics import mcnemar, quantiles, wilson_interval
from agents.evaluation.store import TrialStore, read_rows
from agents.evaluation.summary import present_sets, summarise, summarise_agent
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import jsonable
from dexgrasp_env.objects.catalogue import OBJECT_SETS
from dexgrasp_env.rendering import rendering_fault


class Still(Agent):
    """Asks for nothing and does nothing; remembers what it was told."""

    env_settings: ClassVar = {"control_mode": "joint_delta"}

    def reset(self, observation, info):
        self.info = info
        self.report = Report(planning_seconds=0.5)

    def act(self, observation):
        return np.zeros(23, np.float32)


class Breaks(Still):
    """Raises in the third step."""

    def act(self, observation):
        self.count = getattr(self, "count", 0) + 1
        if self.count == 3:
            raise ZeroDivisionError("on purpose")
        return super().act(observation)


class BreaksAtReset(Still):
    def reset(self, observation, info):
        raise KeyError("on purpose")


class Gives(Still):
    """Gives whatever it is told to."""

    action: ClassVar = None

    def act(self, observation):
        return self.action


class HasNoPlan(Still):
    def reset(self, observation, info):
        certificate = {
            "distances_cm": [-0.5, -0.4, -0.3],
            "force_ratio_percent": 1.0,
            "holds": False,
            "extra": np.nan,
        }
        self.report = Report(failure="no_grasp", planning_seconds=1.5, details={"certificate": certificate})


class Duck:
    """Not a subclass of anything."""

    def reset(self, observation, info):
        self.space = info["action_space"]

    def act(self, observation):
        return self.space.low


class Wants(Still):
    env_settings: ClassVar = {"friction": 2.0}


@pytest.fixture(scope="module")
def env():
    return gym.make("DexGrasp/Lift-v1", objects="gelatin_box", max_episode_steps=6, disable_env_checker=True)


SEEDS = trial_seeds(0, "gelatin_box", 0)


def run_trial(env, agent, seeds):
    return one_trial.run_trial(env, agent, seeds)[0]


# -- statistics -------------------------------------------------------------------------------------------------


def test_wilson_interval_against_published_values():
    # Newcombe (1998), table I, method 3: 81/263, 15/148, 0/20, 1/29.
    for k, n, low, high in [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ]:
        assert wilson_interval(k, n) == pytest.approx((low, high), abs=5e-5)
    assert wilson_interval(5, 5)[1] == 1.0
    assert wilson_interval(0, 0) == (0.0, 1.0)
    with pytest.raises(ValueError, match="3 successes"):
        wilson_interval(3, 2)


def test_wilson_covers_as_it_says():
    rng = np.random.default_rng(0)
    for p in (0.1, 0.5, 0.94):
        inside = [
            low <= p <= high for low, high in (wilson_interval(int(k), 18) for k in rng.binomial(18, p, 2000))
        ]
        assert np.mean(inside) > 0.92


def test_mcnemar_is_exact():
    a = {i: i < 9 for i in range(20)}
    b = {i: 8 <= i < 10 for i in range(25)}
    result = mcnemar(a, b)
    assert {k: result[k] for k in ("both", "only_a", "only_b", "neither")} == {
        "both": 1,
        "only_a": 8,
        "only_b": 1,
        "neither": 10,
    }
    assert result["p_value"] == pytest.approx(2 * (1 + 9) / 2**9)
    assert mcnemar({1: True}, {1: True})["p_value"] == 1.0


def test_quantiles():
    assert quantiles([1.0, 2.0, 3.0], median=0.5, p75=0.75) == {"median": 2.0, "p75": 2.5}
    assert quantiles([], median=0.5) == {}


# -- protocol ---------------------------------------------------------------------------------------------------


def test_seeds_depend_on_seed_object_and_trial_alone():
    assert trial_seeds(3, "soda", 1) == trial_seeds(3, "soda", 1)
    assert trial_seeds(3, "/here/scan.stl", 1) == trial_seeds(3, "elsewhere/scan.stl", 1)
    seeds = {trial_seeds(s, o, k) for s in range(3) for o in ("soda", "chips", "mask") for k in range(4)}
    assert len(seeds) == 36
    assert len({t.scene for t in seeds} | {t.agent for t in seeds}) == 72


def test_seeds_are_frozen():
    """Published numbers rest on them: a change is another protocol."""
    assert trial_seeds(0, "sugar_box", 0).scene == 2272584501


def test_agents_choose_only_what_is_theirs():
    assert agent_settings("still", Still()) == {"control_mode": "joint_delta"}
    with pytest.raises(InputError, match="friction"):
        agent_settings("wants", Wants())
    with pytest.raises(InputError, match="lift"):
        get_protocol("lift-v9")


def test_settings_are_checked():
    assert EvaluationSettings.of(["a", "a"], ["seen", "soda", "soda"]).objects == (
        *OBJECT_SETS["seen"],
        "soda",
    )
    for agents, objects, rest in ([], ["seen"], {}), (["a"], ["nope"], {}), (["a"], ["seen"], {"trials": 0}):
        with pytest.raises(InputError):
            EvaluationSettings.of(agents, objects, **rest)


# -- trials -----------------------------------------------------------------------------------------------------


def test_agents_are_told_nothing_of_the_object(env):
    agent = Still()
    outcome = run_trial(env, agent, SEEDS)
    assert set(agent.info) == {"action_space", "control_period", "mount", "obs_mode", "control_mode"}
    assert outcome.reason == "not_touched"
    assert outcome.steps == 6
    assert outcome.planning_seconds == 0.5


def test_exceptions_of_agents_fail_the_trial_with_their_traceback(env):
    outcome = run_trial(env, Breaks(), SEEDS)
    assert outcome.reason == "agent_error: ZeroDivisionError"
    assert outcome.steps == 2
    assert "on purpose" in outcome.error
    assert "test_evaluation.py" in outcome.error
    assert run_trial(env, BreaksAtReset(), SEEDS).reason == "agent_error: KeyError"


@pytest.mark.parametrize("action", [None, "left", np.zeros(5), np.full(23, np.nan), [[1], [2, 3]], {"a": 1}])
def test_wrong_actions_fail_the_trial(env, action):
    agent = Gives()
    agent.action = action
    outcome = run_trial(env, agent, SEEDS)
    assert outcome.reason == "invalid_action"
    assert outcome.error


def test_agents_without_a_plan(env):
    outcome = run_trial(env, HasNoPlan(), SEEDS)
    assert (outcome.reason, outcome.steps, outcome.success) == ("no_grasp", 0, False)
    assert outcome.details["certificate"]["extra"] is None


def test_a_failed_reset_does_not_bear_the_last_report(env):
    agent = HasNoPlan()
    run_trial(env, agent, SEEDS)
    agent.reset = BreaksAtReset().reset
    outcome = run_trial(env, agent, SEEDS)
    assert outcome.planning_seconds is None
    assert outcome.details == {}


def test_duck_typed_agents_do(env):
    assert run_trial(env, Duck(), SEEDS).error is None


def test_jsonable():
    value = {"a": np.float32(1.5), 2: [np.int64(3), float("inf")], "c": np.eye(2), "d": Report(), "e": {1}}
    text = json.dumps(jsonable(value), allow_nan=False)
    assert json.loads(text) == {
        "a": 1.5, "2": [3, None], "c": [[1, 0], [0, 1]], "e": [1],
        "d": {"failure": None, "planning_seconds": None, "details": {}},
    }  # fmt: skip


# -- the store --------------------------------------------------------------------------------------------------


def row(agent="a", name="soda", trial=0, success=False, **rest):
    values = {
        "agent": agent, "object": name, "trial": trial, "scene_seed": trial, "success": success, "stable": success,
        "reason": None if success else "dropped", "planning_seconds": 1.0 + trial, "details": {}, "error": None,
    }  # fmt: skip
    return values | rest


def test_partial_last_line_is_dropped(tmp_path):
    store = TrialStore(tmp_path, {"seed": 1})
    store.append(row(trial=0))
    store.append(row(trial=1))
    store.close()
    path = tmp_path / "trials.jsonl"
    path.write_text(path.read_text()[:-20])
    store = TrialStore(tmp_path, {"seed": 1})
    assert store.finished == {("", "a", "soda", 0)}
    store.append(row(trial=1))
    store.close()
    assert [r["trial"] for r in read_rows(tmp_path)] == [0, 1]


def test_another_evaluation_in_the_same_folder_is_refused(tmp_path):
    TrialStore(tmp_path, {"seed": 1, "agents": ["a"]}).close()
    with pytest.raises(InputError, match=r"seed was 1, is 2.*--out"):
        TrialStore(tmp_path, {"seed": 2, "agents": ["a"]})


def test_two_writers_are_refused(tmp_path):
    store = TrialStore(tmp_path, {})
    with pytest.raises(InputError, match="another evaluation"):
        TrialStore(tmp_path, {})
    store.close()


def test_damaged_line_is_named(tmp_path):
    (tmp_path / "trials.jsonl").write_text("what?\n")
    with pytest.raises(InputError, match="line 1"):
        read_rows(tmp_path)
    with pytest.raises(InputError, match="no evaluation"):
        read_rows(tmp_path / "nowhere")


def test_a_trial_counts_once(tmp_path):
    line = json.dumps(row(success=True)) + "\n"
    (tmp_path / "trials.jsonl").write_text(line * 3)
    assert len(read_rows(tmp_path)) == 1
    (tmp_path / "run.json").write_text('{"seed": 1}')
    store = TrialStore(tmp_path, {"seed": 1})
    assert len(store.rows) == 1
    store.close()


@pytest.mark.parametrize(
    "line",
    [
        b'{"agent": "\xff"}', b"[]", b"3", b"{}", b"[" * 100_000, b'{"trial": ' + b"9" * 5000 + b"}",
        json.dumps(row() | {"trial": "0"}).encode(), json.dumps(row(success=1)).encode(),
        json.dumps(row(details=[])).encode(), json.dumps(row(planning_seconds=float("nan"))).encode(),
        json.dumps(row(details={"certificate": {"closure_margin": "much"}})).encode(),
        json.dumps(row(scene_seed=-1)).encode(),
    ],
)  # fmt: skip
def test_damaged_lines_are_named_in_one_line(tmp_path, line):
    (tmp_path / "trials.jsonl").write_bytes(line + b"\n")
    with pytest.raises(InputError, match=r"line 1 is (not JSON|no trial)") as caught:
        read_rows(tmp_path)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("content", [None, b"[]", b"\xff\xfe", b"{", b"null", b"[" * 100_000])
def test_trials_without_their_settings_are_refused(tmp_path, content):
    (tmp_path / "trials.jsonl").write_text(json.dumps(row()) + "\n")
    if content is not None:
        (tmp_path / "run.json").write_bytes(content)
    with pytest.raises(InputError, match="choose another --out"):
        TrialStore(tmp_path, {"seed": 1})
    assert (tmp_path / "trials.jsonl").read_text()


# -- running ----------------------------------------------------------------------------------------------------

SETTINGS = EvaluationSettings.of(["random"], ["sugar_box", "gelatin_box"], trials=2, seed=3)


def outcomes(folder):
    names = ("success", "reason", "stage", "steps", "height", "slip", "scene_seed")
    return {(r["agent"], r["object"], r["trial"]): [r[n] for n in names] for r in read_rows(folder)}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished")
    return folder, evaluate(SETTINGS, folder, progress=False)


def test_summary_has_the_documented_form(finished):
    folder, summary = finished
    assert json.loads((folder / "summary.json").read_text()) == json.loads(json.dumps(summary))
    assert summary["schema"] == 1
    assert (summary["protocol"], summary["seed"], summary["complete"]) == ("lift", 3, True)
    agent = summary["agents"]["random"]
    assert {
        "trials",
        "successes",
        "rate",
        "ci95",
        "by_set",
        "by_object",
        "failures",
        "planning_seconds",
        "constraints",
    } <= set(agent)
    assert (agent["trials"], agent["by_object"]["sugar_box"]) == (4, {"trials": 2, "successes": 0})
    assert set(agent["by_set"]) == {"seen", "ycb6"}
    assert {"trials", "successes", "rate", "ci95"} <= set(agent["by_set"]["seen"])
    assert sum(agent["failures"].values()) == 4 - agent["successes"]


def test_outcomes_do_not_depend_on_the_workers(finished, tmp_path):
    evaluate(SETTINGS, tmp_path, workers=2, progress=False)
    assert outcomes(tmp_path) == outcomes(finished[0])


def test_what_is_finished_is_not_run_again(finished, tmp_path):
    lines = (finished[0] / "trials.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "run.json").write_text((finished[0] / "run.json").read_text())
    (tmp_path / "trials.jsonl").write_text("".join(lines[:2]) + lines[2][:30])
    evaluate(SETTINGS, tmp_path, progress=False)
    assert (tmp_path / "trials.jsonl").read_text().startswith("".join(lines[:2]))
    assert outcomes(tmp_path) == outcomes(finished[0])


def test_killed_run_keeps_what_is_finished(tmp_path):
    command = [
        sys.executable,
        "-m",
        "agents.cli.main",
        "evaluate",
        "--agents",
        "random",
        "--objects",
        "sugar_box",
    ]
    command += ["--trials", "400", "--out", str(tmp_path / "out"), "--json", "--workers", "2"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    trials = tmp_path / "out" / "trials.jsonl"
    for _ in range(300):
        if trials.is_file() and trials.read_text().count("\n") >= 3:
            break
        time.sleep(0.1)
    process.send_signal(signal.SIGTERM)
    out, error = process.communicate(timeout=30)
    assert process.returncode == 3, error
    kept = len(read_rows(tmp_path / "out"))
    assert 3 <= kept < 400
    summary = json.loads(out)
    assert summary["complete"] is False
    assert summary["agents"]["random"]["trials"] == kept
    assert "goes on" in error


def test_cells_and_labels(tmp_path):
    settings = EvaluationSettings(("a", "m:B"), ("soda", "x/soda.stl", "y/soda.stl", "z/cup.obj"), trials=3)
    labels = object_labels(settings.objects)
    assert labels["soda"] == "soda"
    assert labels["z/cup.obj"] == "cup"
    assert len(set(labels.values())) == 4
    specs = plan_trials(settings)
    assert len(specs) == len(set(specs)) == 24
    assert specs[0] == TrialSpec("a", "soda", "soda", 0, "lift")


def test_several_protocols_are_counted_apart():
    settings = EvaluationSettings(("a",), ("soda",), trials=2, protocols=("lift", "heavy"))
    assert [(spec.protocol, spec.trial) for spec in plan_trials(settings)] == [
        ("lift", 0), ("lift", 1), ("heavy", 0), ("heavy", 1),
    ]  # fmt: skip
    rows = [row(trial=k, success=p == "lift", protocol=p) for p in settings.protocols for k in range(2)]
    summary = summarise(settings, rows)
    agent = summary["agents"]["a"]
    assert (summary["protocol"], summary["complete"], agent["trials"]) == ("lift+heavy", True, 4)
    assert {name: part["rate"] for name, part in agent["by_protocol"].items()} == {"lift": 1.0, "heavy": 0.0}


def test_identity_changes_with_the_content(tmp_path):
    mesh = tmp_path / "thing.stl"
    mesh.write_text("one")
    settings = EvaluationSettings(("random",), (str(mesh),))
    before, folder = settings.identity(), settings.default_folder()
    assert settings.default_folder() == folder
    mesh.write_text("two")
    assert settings.identity() != before
    assert settings.default_folder() != folder


def test_identity_knows_every_file(tmp_path, monkeypatch):
    """Meshes of one name, checkpoints and the settings beside them, a path from home."""
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in ("a/x.obj", "b/x.obj", "p.zip", "p.json", "q.zip"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("one")
    agents = (f"ppo:{tmp_path}/p.zip", f"{tmp_path}/q.zip")
    settings = EvaluationSettings(agents, (f"{tmp_path}/a/x.obj", "~/b/x.obj"))
    known = settings.identity()
    assert len(known["files"]) == 5
    for name in ("a/x.obj", "b/x.obj", "p.zip", "p.json", "q.zip", "q.json"):
        (tmp_path / name).write_text("two")
        changed = settings.identity()
        assert changed != known, name
        known = changed


def test_replay_is_exact(finished, tmp_path):
    folder, _ = finished
    for name in ("sugar_box", "gelatin_box"):
        again = replay(folder, "random", name, 1)
        assert again.changed == again.stale == ()
        assert again.again["height"] == again.row["height"]
    rows = read_rows(folder)
    assert all({"scene_seed", "agent_seed", "env", "protocol"} <= set(r) for r in rows)
    assert rows[0]["env"]["id"] == get_protocol("lift").env_id
    rows[0]["slip"] += 1e-9
    (tmp_path / "trials.jsonl").write_text("\n".join(map(json.dumps, rows)) + "\n")
    (tmp_path / "run.json").write_text((folder / "run.json").read_text())
    key = [rows[0][name] for name in ("agent", "object", "trial")]
    assert replay(tmp_path, *key).changed == ("slip",)
    with pytest.raises(InputError, match=r"hardcoded.*random"):
        replay(folder, "hardcoded", "sugar_box", 0)
    with pytest.raises(InputError, match="valid are 0, 1"):
        replay(folder, "random", "sugar_box", 7)


def test_a_foreign_trial_is_refused(finished, tmp_path):
    line = json.loads((finished[0] / "trials.jsonl").read_text().splitlines()[0]) | {"agent": "somebody"}
    (tmp_path / "trials.jsonl").write_text(json.dumps(line) + "\n")
    (tmp_path / "run.json").write_text((finished[0] / "run.json").read_text())
    with pytest.raises(InputError, match="somebody"):
        evaluate(SETTINGS, tmp_path, progress=False)


@pytest.mark.skipif(rendering_fault() is not None, reason="no GL library here")
def test_videos_of_a_finished_run(finished, tmp_path, monkeypatch):
    monkeypatch.setattr("agents.evaluation.video.Video.add", lambda self, env: write_one(self))
    shutil.copytree(finished[0], tmp_path / "run")
    evaluate(SETTINGS, tmp_path / "run", videos=1, progress=False)
    films = {path.name for path in (tmp_path / "run" / "videos").iterdir()}
    assert films == {"lift-random-sugar_box-0.mp4", "lift-random-gelatin_box-0.mp4"}
    evaluate(SETTINGS, tmp_path / "run", videos="failures", progress=False)
    failed = [r for r in read_rows(tmp_path / "run") if not r["success"]]
    assert len(list((tmp_path / "run" / "videos").iterdir())) == len(failed) == 4
    assert len(read_rows(tmp_path / "run")) == 4


def write_one(video):
    """Stand in for drawing, which is slow in software."""

    class Writer:
        def close(self):
            video._part.parent.mkdir(exist_ok=True)
            video._part.write_bytes(b"film")

    video._writer = Writer()


def test_every_mesh_is_looked_at_before_the_first_trial(tmp_path):
    (tmp_path / "bad.obj").write_text("v 0 0 0\n")
    settings = EvaluationSettings.of(["random"], ["sugar_box", str(tmp_path / "bad.obj")])
    with pytest.raises(InputError, match=r"bad\.obj"):
        evaluate(settings, tmp_path / "out", progress=False)
    assert not (tmp_path / "out" / "trials.jsonl").exists()


# -- summaries, tables, reports ---------------------------------------------------------------------------------


def some_rows(agent, seed):
    rng = np.random.default_rng(seed)
    rows = []
    for name in (*OBJECT_SETS["seen"], *OBJECT_SETS["familiar"], *OBJECT_SETS["novel"], "my_mesh"):
        for trial in range(3):
            certificate = {
                "distances_cm": rng.uniform(-0.7, -0.3, 3).tolist(), "force_ratio_percent": float(rng.random()),
                "torque_ratio_percent": float(rng.random()), "closure_margin": 0.1, "holds": True,
            }  # fmt: skip
            details = {"certificate": certificate, "stage_seconds": {"ik": 0.1}, "stage_repeats": {"ik": 2}}
            rows.append(row(agent, name, trial, bool(rng.random() < 0.7), details=details))
    return rows


def test_sets_are_counted_apart():
    agent = summarise_agent(some_rows("bilevel", 0))
    assert {name: cell["trials"] for name, cell in agent["by_set"].items()} == {
        "seen": 9, "familiar": 12, "novel": 39, "meshes": 3,
    }  # fmt: skip
    assert set(present_sets(list(OBJECT_SETS["ycb6"]))) == {"seen", "ycb6"}


def test_constraints_as_tables_4_to_6():
    rows = some_rows("bilevel", 0)
    agent = summarise_agent(rows)
    distances = [d for r in rows for d in r["details"]["certificate"]["distances_cm"]]
    found = agent["constraints"]
    assert (found["grasps"], found["hold"]) == (63, 63)
    assert found["distance_cm"]["median"] == pytest.approx(np.median(distances))
    assert found["distance_cm"]["max_violation"] == pytest.approx(
        max(0, -0.68 - min(distances), max(distances) + 0.32)
    )
    assert set(found["by_set"]) == {"seen", "familiar", "novel", "meshes"}
    assert found["torque_ratio_percent"]["p75"] <= 1.0
    assert agent["stages"]["overall"]["stage_seconds"]["ik"]["median"] == pytest.approx(0.1)
    assert summarise_agent([row()])["constraints"] == {}


def test_paired_comparison_and_table():
    settings = EvaluationSettings(("bilevel", "hardcoded"), ("soda",), trials=2)
    rows = [
        row("bilevel", trial=0, success=True),
        row("bilevel", trial=1, success=True),
        row("hardcoded", trial=0),
    ]
    summary = summarise(settings, rows)
    assert summary["complete"] is False
    assert summary["paired"][0]["only_a"] == 1
    text = render_summary(summary)
    assert "2/2 (6/6)" in text  # ours (the paper's)
    assert "95.8 % 23/24" not in text.splitlines()[2]
    assert "dropped" in text


def test_report_has_the_papers_tables_beside_ours(tmp_path):
    for name, seed in (("bilevel", 0), ("hardcoded", 1)):
        store = TrialStore(
            tmp_path / name, {"protocol": "lift-v0", "seed": 0, "trials": 3, "versions": {"mujoco": "3"}}
        )
        for line in some_rows(name, seed):
            store.append(line)
        store.close()
    text = write_report([tmp_path / "bilevel", tmp_path / "hardcoded"], tmp_path / "report")
    for words in ("Table 1", "Table 2", "Table 3", "Table 4", "Table 5", "Table 6", "94.4 % 17/18", "38.5 % 15/39",
                  "McNemar", "my_mesh", "0.01 (0.00, 8.48)"):  # fmt: skip
        assert words in text, words
    assert (tmp_path / "report" / "report.md").read_text() == text
    for plot in ("success_by_set.png", "success_by_object.png"):
        assert (tmp_path / "report" / plot).stat().st_size > 10_000


def test_papers_rows_add_up_to_its_sums():
    printed = {
        "bilevel": {"seen": (17, 18), "familiar": (23, 24), "novel": (64, 78)},
        "cvae": {"seen": (7, 18)},
        "cvae_kinematics": {"seen": (16, 18)},
        "hardcoded": {"seen": (8, 9), "familiar": (9, 12), "novel": (15, 39)},
    }
    for agent, sets in printed.items():
        for name in paper.TABLES:
            assert paper.set_successes(agent, OBJECT_SETS[name]) == sets.get(name)


def test_rates_are_finite_numbers():
    agent = summarise_agent([])
    assert agent["rate"] == 0.0
    assert all(math.isfinite(end) for end in agent["ci95"])
