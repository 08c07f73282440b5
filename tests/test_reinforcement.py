"""Reinforcement: resuming to the same bits, corrections that begin at the clone, agents by their path."""

from functools import partial

import numpy as np
import pytest
from refusals import refused
from trainings import begun, goes_on_to_the_same_bits

from dexgrasp.data.demonstrations.generate import generate
from dexgrasp.data.demonstrations.settings import DemoSettings
from dexgrasp.registry import make_agent
from dexgrasp.runs.policy_folder import read_policy, write_policy
from dexgrasp_env.valid import read

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
import gymnasium as gym
import torch

import dexgrasp_env  # noqa: F401
from dexgrasp.learning.reinforcement import rl_tasks
from dexgrasp.learning.reinforcement.grasp_space import GraspSpace
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


@pytest.mark.parametrize("name", ["tomato_soup_can", "lego"])
def test_every_height_of_the_grasp_space_is_above_the_table(name):
    env = gym.make("DexGrasp/Lift-v2", objects=name, control_mode="ee_delta")
    heights = []
    for height in (-1.0, -0.8):
        observation, _ = env.reset(seed=1)
        observations = {key: value[None] for key, value in observation.items()}
        space = GraspSpace(env.unwrapped.settings.cell.robot, observations)
        action = np.array([[0.2, -0.56, height, 0.0, 0.5, -1.0, -1.0]])
        for _ in range(40):
            observation, *_ = env.step(space.env_actions(action, observations)[0])
            observations = {key: value[None] for key, value in observation.items()}
        heights.append(observations["palm_pose"][0, 2])
        np.testing.assert_allclose(space.state(observations), action, atol=0.2)
    assert 0.11 < heights[0] < heights[1] - 0.01


def test_what_lies_beyond_an_action_is_folded_back():
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", control_mode="ee_delta")
    observations = {key: value[None] for key, value in env.reset(seed=1)[0].items()}
    space = GraspSpace(env.unwrapped.settings.cell.robot, observations)
    for beyond, within in ((1.5, 0.5), (-1.25, -0.75), (3.0, -1.0), (2.0, 0.0), (-4.5, -0.5), (0.9, 0.9)):
        told = [space.env_actions(np.full((1, 7), value), observations) for value in (beyond, within)]
        np.testing.assert_allclose(*told, atol=1e-6)
    settings = settings_of("ppo", control_mode="grasp", action_repeat=3)
    envs = PolicyTask(settings).environments(torch.device("cpu"))
    assert envs.action_space.high[0] == 3.0  # what PPO draws is not cut off before it is folded
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
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", control_mode="ee_delta")
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
