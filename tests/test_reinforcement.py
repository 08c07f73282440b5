"""Reinforcement: resuming to the same bits, corrections that begin at the clone, agents by their path."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from refusals import refused
from trainings import begun, goes_on_to_the_same_bits

from dexgrasp.data.demonstrations.generate import generate
from dexgrasp.data.demonstrations.resets import DemoResets
from dexgrasp.data.demonstrations.settings import DemoSettings
from dexgrasp.evaluation.settings import EvaluationSettings, plan_trials
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.registry import make_agent
from dexgrasp.runs.policy_folder import read_policy, write_policy
from dexgrasp_env.valid import read

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
import gymnasium as gym
import torch
from stable_baselines3 import SAC

import dexgrasp_env  # noqa: F401
from dexgrasp.learning.reinforcement import rl_tasks
from dexgrasp.learning.reinforcement.demo_replay import add_demonstrations
from dexgrasp.learning.reinforcement.rl_tasks import PolicyTask
from dexgrasp.learning.reinforcement.rollout_training import RolloutTraining
from dexgrasp.learning.reinforcement.settings import GripSettings, RlSettings


@pytest.fixture(autouse=True)
def short_rounds(monkeypatch):
    monkeypatch.setattr(RlSettings, "limit", property(lambda settings: settings.episode_steps or 12))
    monkeypatch.setattr(rl_tasks, "_MEASURED", 4)


def settings_of(algorithm, **more):
    short = {
        "steps": 60,
        "num_envs": 2,
        "net_arch": (16, 12),
        "n_steps": 6,
        "buffer_size": 500,
        "learning_starts": 10,
    }
    return RlSettings(("sugar_box",), algorithm, **short, **more)


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_training_goes_on_to_the_same_bits_and_gives_an_agent(algorithm, tmp_path, clone):
    more = (
        {"adaptive": True, "log_std_final": -3.0} if algorithm == "ppo" else {}
    )  # what is kept between updates
    settings = settings_of(algorithm, **more)
    base = clone if algorithm == "ppo" else None
    task = partial(PolicyTask, settings, base)
    assert goes_on_to_the_same_bits(RolloutTraining, task, tmp_path).epoch == 3
    assert not [path for path in tmp_path.rglob("*") if path.suffix in (".zip", ".pkl", ".pth")]
    begun(tmp_path / "whole", 1)
    with refused("other settings"):
        RolloutTraining(PolicyTask(settings_of(algorithm, seed=1), base), tmp_path / "parts").run()


def test_episodes_begin_along_demonstrations(tmp_path):
    pytest.importorskip("minari")
    generate(DemoSettings.of(["sugar_box"], agent="hardcoded", episodes=1), tmp_path / "demos")
    more = {"control_mode": "ee_delta", "residual_scale": 0.5, "randomise": (("mass", 1.0, 1.05),)}
    settings = settings_of("ppo", resets=str(tmp_path / "demos"), **more)
    whole = RolloutTraining(PolicyTask(settings), tmp_path / "whole").run()
    assert [row["front"] for row in whole.curve] == [0.9] * 3
    assert make_agent(str(tmp_path / "whole")).env_settings["control_mode"] == "ee_delta"


@pytest.fixture(scope="module")
def demos(tmp_path_factory):
    pytest.importorskip("minari")
    folder = tmp_path_factory.mktemp("own") / "demos"
    generate(DemoSettings.of(["sugar_box"], agent="hardcoded", episodes=1), folder)
    return folder


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


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_round_is_as_long_as_an_episode(algorithm, monkeypatch):
    monkeypatch.undo()
    for more in (
        {"action_repeat": 7},
        {"env_id": "DexGrasp/LiftPushed-v2"},
        {"episode_steps": 84, "action_repeat": 5},
    ):
        settings = RlSettings(("sugar_box",), algorithm, **more)
        limit = more.get("episode_steps") or gym.spec(settings.env_id).max_episode_steps
        assert 0 <= settings.length * settings.span - limit < settings.span


@pytest.mark.parametrize(
    ("more", "rollouts"),
    [
        ({}, (3, 100)),
        ({"action_repeat": 2}, (2, 75)),
        ({"n_steps": 32}, (10, 30)),
        ({"n_steps": 1000}, (1, 300)),
        ({"episode_steps": 13, "n_steps": 6}, (3, 5)),
        ({"episode_steps": 1, "num_envs": 1}, (1, 2)),
        ({"episode_steps": 4, "num_envs": 1, "n_steps": 1}, (2, 2)),
    ],
)
def test_rollouts_are_a_round(more, rollouts, monkeypatch):
    monkeypatch.undo()
    settings = RlSettings(("sugar_box",), **more)
    assert settings.rollouts == rollouts
    assert settings.round_steps == settings.num_envs * rollouts[0] * rollouts[1]


def test_as_many_steps_are_done_as_rounds_come_to(tmp_path):
    settings = settings_of("ppo", action_repeat=2, episode_steps=20)  # ten looks, in rollouts of six at most
    state = RolloutTraining(PolicyTask(settings), tmp_path).run()
    assert [row["steps"] for row in state.curve] == [40, 80]


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"env_id": "DexGrasp/Place-v2"}, "valid is DexGrasp/Lift"),
        ({"randomise": [["colour", 0.0, 1.0]]}, "valid are mass, friction, size"),
        ({"randomise": [["mass", 2.0, 1.0]]}, "low <= high"),
        ({"randomise": ["mass"]}, "randomise"),
        ({"net_arch": [64, 0]}, r"net_arch is \[64, 0\]: .* each a whole number >= 1"),
        ({"net_arch": 64}, "net_arch is 64: valid is a list"),
    ],
)
def test_wrong_settings_are_refused(wrong, says):
    with refused(says):
        read(RlSettings, {"objects": "sugar_box"} | wrong)


@pytest.mark.parametrize(
    ("algorithm", "more"),
    [
        ("ppo", {}),
        ("sac", {}),
        ("ppo", {"control_mode": "grasp", "action_repeat": 3}),
        ("ppo", {"action_repeat": 2, "action_chunk": 3}),
    ],
)
def test_the_agent_does_what_the_learner_means(algorithm, more, tmp_path):
    settings = settings_of(algorithm, **more)
    RolloutTraining(PolicyTask(settings), tmp_path / "out").run()
    work = RolloutTraining(PolicyTask(settings), tmp_path / "out")
    work.begin()
    work.envs.seed(5)
    looks = work.envs.reset()
    agent, observation = begun(tmp_path / "out", 5)
    meant, _ = work.model.predict(looks[:1], deterministic=True)
    acted = [agent.act(observation) for _ in range(settings.span)]
    np.testing.assert_allclose(
        acted, np.repeat(acted[:: settings.action_repeat], settings.action_repeat, axis=0)
    )
    if not more:
        np.testing.assert_allclose(acted[0], meant[0], atol=1e-4)
    played = []
    work.envs.venv.step = lambda actions, step=work.envs.venv.step: played.append(actions) or step(actions)
    work.envs.step(np.repeat(meant, 2, axis=0))
    assert len(played) == settings.span
    np.testing.assert_allclose(played[0][0], acted[0], atol=1e-4)
    if not work.task.spec.grasps:  # in which what is carried out follows from what is seen as well
        np.testing.assert_allclose([actions[0] for actions in played], acted, atol=1e-4)
    work.envs.close()


def test_grasps_are_learned(tmp_path):
    settings = settings_of("ppo", control_mode="grasp", action_repeat=3, episode_steps=12, noise="rollout")
    whole = RolloutTraining(PolicyTask(settings), tmp_path / "whole").run()
    assert [row["steps"] for row in whole.curve] == [24, 48, 72]


def test_what_ppo_draws_beyond_an_action_is_not_cut_off():
    settings = settings_of("ppo", control_mode="grasp", action_repeat=3)
    envs = PolicyTask(settings).environments(torch.device("cpu"))
    assert envs.action_space.high[0] == 3.0  # the environment mirrors it
    envs.close()


def test_one_answer_is_an_episode_and_its_last_action_stands(tmp_path):
    settings = settings_of("ppo", control_mode="grasp", action_repeat=28, action_chunk=3, episode_steps=84)
    assert settings.length == 1
    RolloutTraining(PolicyTask(settings), tmp_path / "whole").run()
    place, opened, closed = [0.2, -0.56, -0.86, 0.0, 0.5], [-1.0, -1.0], [1.0, 1.0]
    lifted = [0.2, -0.56, 1.0, 0.0, 0.5]
    answer = np.array([*place, *opened, *place, *closed, *lifted, *closed])
    work = RolloutTraining(PolicyTask(settings), tmp_path / "whole")
    work.begin()
    work.envs.seed(1)
    work.envs.reset()
    _, rewards, dones, _ = work.envs.step(np.tile(answer, (2, 1)))
    assert dones.all()
    assert rewards.min() > 30.0  # 25 is all there is for a grasp that does not lift
    work.envs.close()

    about, arrays = read_policy(tmp_path / "whole")
    arrays = {name: 0.0 * array if name.startswith("actor.") else array for name, array in arrays.items()}
    write_policy(tmp_path / "whole", about, arrays | {"actor.2.bias": answer.astype(np.float32)})
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", control_mode="grasp")
    agent = make_agent(str(tmp_path / "whole"))
    observation, info = env.reset(seed=1)
    agent.reset(observation, info)
    for _ in range(150):
        observation, *_, info = env.step(agent.act(observation))
    assert info["is_success"]


def test_a_rate_follows_the_divergence(tmp_path):
    def rates(divergence):
        settings = settings_of("ppo", adaptive=True, target_kl=divergence)
        whole = RolloutTraining(PolicyTask(settings), tmp_path / str(divergence)).run()
        return [row["rate"] for row in whole.curve]

    # Two updates a round: the second one knows of the first.
    np.testing.assert_allclose(rates(10.0), 3e-4 * 1.5 ** np.arange(1, 4))
    np.testing.assert_allclose(rates(1e-9), 3e-4 / 1.5 ** np.arange(1, 4))


def test_exploring_gets_less_as_told(tmp_path):
    settings = settings_of("ppo", log_std_final=-3.0)
    work = RolloutTraining(PolicyTask(settings), tmp_path / "more")
    work.run()
    assert work.model.policy.log_std.mean().item() == pytest.approx(
        -2.6, abs=0.05
    )  # of the last round's begin


def test_a_correction_begins_at_the_clone(tmp_path, clone):
    settings = settings_of("ppo")
    work = RolloutTraining(PolicyTask(settings, clone), tmp_path)
    work.begin()
    work.state.curve.append({})
    work.write()
    work.envs.close()
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box")
    observation, info = env.reset(seed=3)
    agents = [make_agent(str(path)) for path in (clone, tmp_path)]
    for agent in agents:
        agent.reset(observation, info)
    for _ in range(6):
        actions = [agent.act(observation) for agent in agents]
        np.testing.assert_array_equal(*actions)
        observation, *_ = env.step(actions[0])
    assert np.abs(actions[0]).max() > 0.0


def test_policies_of_0_3_0_are_read(tmp_path):
    settings = settings_of("ppo", action_repeat=2, action_chunk=3)
    RolloutTraining(PolicyTask(settings), tmp_path).run(stop_after=1)
    about, arrays = read_policy(tmp_path)
    was = {"residual_scale": "share", "action_repeat": "hold", "action_chunk": "chunk"}
    write_policy(tmp_path, {was.get(key, key): value for key, value in about.items()}, arrays)
    spec = make_agent(str(tmp_path))._policy.spec
    assert (spec.residual_scale, spec.action_repeat, spec.action_chunk) == (1.0, 2, 3)


def test_grasp_policies_of_0_3_0_act_by_the_control_mode_of_today(tmp_path):
    """It wrote the control mode that its grasp space was made of."""
    RolloutTraining(PolicyTask(settings_of("ppo", control_mode="grasp")), tmp_path).run(stop_after=1)
    about, arrays = read_policy(tmp_path)
    was = about | {"env": about["env"] | {"control_mode": "ee_delta"}, "grasps": True}
    agents = []
    for told in (about, was):
        write_policy(tmp_path, told, arrays)
        agents.append(begun(tmp_path, 3))
    assert agents[1][0].env_settings["control_mode"] == "grasp"
    np.testing.assert_array_equal(*(agent.act(observation) for agent, observation in agents))


@pytest.mark.parametrize(("name", "looks", "own"), [("LiftOnce", 1, {}), ("LiftStaged", 6, {"hold": 28})])
def test_tasks_for_plain_learners_are_trained_on_as_they_are(name, looks, own, tmp_path, monkeypatch):
    monkeypatch.undo()
    monkeypatch.setattr(rl_tasks, "_MEASURED", 4)
    settings = replace(settings_of("ppo", env_id=f"DexGrasp/{name}-v0"), steps=2 * looks)
    assert settings.length == looks
    RolloutTraining(PolicyTask(settings), tmp_path).run()
    asked = make_agent(str(tmp_path)).env_settings
    assert {key: asked[key] for key in own} == own
    settings = EvaluationSettings.of([str(tmp_path)], ["sugar_box"], trials=1, seed=0)
    row, _ = TrialRunner(settings).run(plan_trials(settings)[0])
    assert row["error"] is None
    assert row["steps"] <= (1 if looks == 1 else 11)  # as many seconds as others have, in fewer actions


def test_grips_are_trained_in_the_newest_environment():
    versions = [
        each.version for each in gym.registry.values() if (each.namespace, each.name) == ("DexGrasp", "Lift")
    ]
    assert GripSettings(("pear",)).env_id == f"DexGrasp/Lift-v{max(versions)}"


def test_clones_of_clouds_are_refused(tmp_path, clone):
    about, arrays = read_policy(clone)
    write_policy(clone, about | {"env": {"obs_mode": "state", "control_mode": "joint_position"}}, arrays)
    assert make_agent(str(clone))
    with refused("clone another"):
        PolicyTask(settings_of("ppo"), clone)
