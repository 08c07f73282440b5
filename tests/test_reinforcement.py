"""Reinforcement: resuming to the same bits, episodes along demonstrations, agents by their path."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from refusals import refused
from tables import mistakes, table
from trainings import begun, goes_on_to_the_same_bits

from dexgrasp.data.demonstrations.generate import generate
from dexgrasp.data.demonstrations.resets import DemoResets
from dexgrasp.data.demonstrations.settings import DemoSettings
from dexgrasp.evaluation.settings import EvaluationSettings, plan_trials
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.registry import make_agent
from dexgrasp.runs.weights import read_policy, write_policy
from dexgrasp_env.valid import read

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
import gymnasium as gym
from stable_baselines3 import SAC

from dexgrasp.learning.reinforcement.demo_replay import add_demonstrations
from dexgrasp.learning.reinforcement.rl_training import RlTraining
from dexgrasp.learning.reinforcement.settings import RlSettings


def settings_of(algorithm, **more):
    return RlSettings(("sugar_box",), algorithm, **table("short_training") | more)


@pytest.fixture(scope="module")
def demos(tmp_path_factory):
    pytest.importorskip("minari")
    folder = tmp_path_factory.mktemp("own") / "demos"
    generate(DemoSettings.of(["sugar_box"], agent="hardcoded", episodes=1), folder)
    return folder


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_training_goes_on_to_the_same_bits_and_gives_an_agent(algorithm, tmp_path, demos):
    more = {"log_std_final": -3.0, "resets": str(demos)} if algorithm == "ppo" else {}
    settings = settings_of(algorithm, **more)
    state = goes_on_to_the_same_bits(partial(RlTraining, settings), tmp_path)
    assert [row["steps"] for row in state.curve] == [24, 48, 72]
    assert all("return" in row and "training_success" in row for row in state.curve)
    assert not [path for path in tmp_path.rglob("*") if path.suffix in (".zip", ".pkl", ".pth")]
    work = RlTraining(settings, tmp_path / "whole")
    work.begin()
    agent, observation = begun(tmp_path / "whole", 1)
    meant, _ = work.model.predict(observation, deterministic=True)
    np.testing.assert_allclose(agent.act(observation), meant, atol=1e-5)
    if algorithm == "ppo":
        assert [row["front"] for row in state.curve] == [0.9] * 3
        deviation = work.model.policy.log_std.mean().item()
        assert deviation == pytest.approx(-2.6, abs=0.05)  # of the last round's begin
    work.close()
    with refused("other settings"):
        RlTraining(replace(settings, seed=1), tmp_path / "parts").run()


def test_staged_grasps_begin_along_demonstrations(demos):
    """In an environment whose actions demonstrations have none of, single and vector alike."""
    env = gym.make("DexGrasp/LiftStaged-v0", objects="sugar_box")
    envs = gym.make_vec("DexGrasp/LiftStaged-v0", num_envs=2, objects="sugar_box")
    for each in (env, envs):
        resets = DemoResets(demos).attach(each)
        resets.whole = 0.0
        assert resets.states[0][-1].of["control_mode"] == "grasp"
    seen, info = env.reset(seed=3)
    many, infos = envs.reset(seed=3)
    np.testing.assert_array_equal(many[0], seen)
    assert info["stage"] == "lifted"  # near the end of it
    assert infos["level"].tolist() == [0.9, 0.9] == [info["level"]] * 2
    keep = np.clip(seen[-7:], -1.0, 1.0)
    keep[5:] = 1.0  # and firmly
    _, reward, *_, info = env.step(keep)
    assert reward > 0.0


def test_demonstrations_fill_a_replay_buffer(demos):
    env = gym.make("DexGrasp/LiftFromGrasp-v0", objects="sugar_box")
    model = SAC("MlpPolicy", env, learning_starts=0, buffer_size=500, device="cpu", seed=0)
    added = add_demonstrations(model, demos)
    buffer = model.replay_buffer
    assert 20 < added == buffer.pos < 150
    assert buffer.rewards[:added].sum() > 15.0  # they succeed in the environment's own actions
    np.testing.assert_array_equal(buffer.observations[1:added], buffer.next_observations[: added - 1])
    assert np.abs(buffer.actions[:added]).max() <= 1.0
    model.learn(2)
    with refused("no actions for"):
        add_demonstrations(
            SAC("MlpPolicy", gym.make("DexGrasp/LiftOnce-v0", objects="sugar_box"), buffer_size=9), demos
        )


@pytest.mark.parametrize(("more", "rollouts"), table("rollouts"))
def test_a_round_is_an_episode_in_equal_rollouts_or_one_of_many(more, rollouts):
    settings = RlSettings(("sugar_box",), **more)
    assert settings.rollouts == tuple(rollouts)
    assert settings.round_steps == settings.num_envs * rollouts[0] * rollouts[1]


@pytest.mark.parametrize(("wrong", "says"), mistakes("training"))
def test_wrong_settings_are_refused(wrong, says):
    with refused(says):
        read(RlSettings, {"objects": "sugar_box"} | wrong)


@pytest.mark.parametrize(("name", "more", "asked"), table("hand_overs"))
def test_tasks_are_trained_on_as_they_are_registered_or_as_told(name, more, asked, tmp_path):
    settings = settings_of("ppo", env_id=f"DexGrasp/{name}", steps=2, **more)
    RlTraining(settings, tmp_path).run()
    assert make_agent(tmp_path).env_settings == {"obs_mode": "features"} | asked
    settings = EvaluationSettings.of([str(tmp_path)], ["sugar_box"], trials=1, seed=0)
    row, _ = TrialRunner(settings).run(plan_trials(settings)[0])
    assert row["error"] is None
    assert 0 < row["steps"] <= 75  # as many seconds as others have, in fewer actions


def test_settings_that_an_environment_refuses_are_refused(tmp_path):
    with refused("hold=4 changes nothing here"):
        RlTraining(settings_of("ppo", env_id="DexGrasp/LiftOnce-v0", hold=4), tmp_path).run()


def test_the_draws_of_a_task_stay_unless_others_are_asked_for():
    kept, other = (
        RlSettings(("drawn-0",), env_id="DexGrasp/LiftVaried-v0", randomise=drawn).env_arguments
        for drawn in ((), (("mass", 0.9, 1.1),))
    )
    assert "randomisation" not in kept
    assert other["randomisation"] == {"mass": (0.9, 1.1)}


def test_policies_of_other_features_or_kinds_are_refused(tmp_path):
    RlTraining(settings_of("ppo", steps=2), tmp_path).run()
    about, arrays = read_policy(tmp_path)
    write_policy(tmp_path, about | {"env": about["env"] | {"control_mode": "ee_delta"}}, arrays)
    agent, env = make_agent(tmp_path), gym.make("DexGrasp/LiftStaged-v0", objects="sugar_box")
    agent.reset(*env.reset(seed=0))
    assert "trained on 92 features" in agent.report.failure
    write_policy(tmp_path, about | {"kind": "actor"}, arrays)
    with refused("kind 'actor': valid are"):
        make_agent(tmp_path)
