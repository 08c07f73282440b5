"""Reinforcement: resuming to the same bits, corrections that begin at the clone, agents by their path."""

from functools import partial

import numpy as np
import pytest
from refusals import refused
from trainings import begun, goes_on_to_the_same_bits

from dexgrasp.demos.generate import generate
from dexgrasp.demos.settings import DemoSettings
from dexgrasp.registry import make_agent
from dexgrasp.runs.policy_folder import read_policy, write_policy
from dexgrasp_env.valid import read

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
import gymnasium as gym  # noqa: E402

import dexgrasp_env  # noqa: E402, F401
from dexgrasp.reinforcement import policy_training  # noqa: E402
from dexgrasp.reinforcement import settings as settings_module  # noqa: E402
from dexgrasp.reinforcement.grasp_space import GraspSpace  # noqa: E402
from dexgrasp.reinforcement.policy_training import PolicyTraining  # noqa: E402
from dexgrasp.reinforcement.settings import RlSettings  # noqa: E402


@pytest.fixture(autouse=True)
def short_rounds(monkeypatch):
    monkeypatch.setattr(settings_module, "MAX_EPISODE_STEPS", 12)
    monkeypatch.setattr(policy_training, "_MEASURED", 4)


def settings_of(algorithm, **more):
    short = {"steps": 60, "num_envs": 2, "hidden": (16, 12), "rollout": 6, "buffer": 500, "warm_up": 10}
    return RlSettings(("sugar_box",), algorithm, **short, **more)


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_training_goes_on_to_the_same_bits_and_gives_an_agent(algorithm, tmp_path, clone):
    settings = settings_of(algorithm)
    base = clone if algorithm == "ppo" else None
    make = partial(PolicyTraining, settings=settings, clone=base)
    assert goes_on_to_the_same_bits(make, tmp_path).epoch == 3
    assert not [path for path in tmp_path.rglob("*") if path.suffix in (".zip", ".pkl", ".pth")]
    begun(tmp_path / "whole", 1)
    with refused("other settings"):
        PolicyTraining(tmp_path / "parts", settings_of(algorithm, seed=1), base).run()


def test_episodes_along_demonstrations_go_on_to_the_same_bits(tmp_path):
    pytest.importorskip("minari")
    generate(DemoSettings.of(["sugar_box"], agent="hardcoded", episodes=1), tmp_path / "demos")
    more = {"control_mode": "ee_delta", "share": 0.5, "randomise": (("mass", 1.0, 1.05),)}
    settings = settings_of("ppo", resets=str(tmp_path / "demos"), **more)
    whole = goes_on_to_the_same_bits(partial(PolicyTraining, settings=settings), tmp_path)
    assert [row["front"] for row in whole.curve] == [0.9] * 3
    assert make_agent(str(tmp_path / "whole")).env_settings["control_mode"] == "ee_delta"


def test_only_lifting_is_learned():
    given = {"objects": "sugar_box", "env_id": "DexGrasp/Place-v2"}
    with refused("valid is DexGrasp/Lift-v1"):
        read(RlSettings, given)


@pytest.mark.parametrize(
    ("algorithm", "more"), [("ppo", {}), ("sac", {}), ("ppo", {"control_mode": "grasp", "hold": 3})]
)
def test_the_agent_does_what_the_learner_means(algorithm, more, tmp_path):
    settings = settings_of(algorithm, **more)
    PolicyTraining(tmp_path / "out", settings).run()
    work = PolicyTraining(tmp_path / "out", settings)
    work.begin()
    work.envs.seed(5)
    looks = work.envs.reset()
    agent, observation = begun(tmp_path / "out", 5)
    meant, _ = work.model.predict(looks[:1], deterministic=True)
    acted = [agent.act(observation) for _ in range(settings.hold)]
    np.testing.assert_allclose(acted, np.tile(acted[0], (settings.hold, 1)))
    if not more:
        np.testing.assert_allclose(acted[0], meant[0], atol=1e-4)
    played = []
    work.envs.venv.step = lambda actions, step=work.envs.venv.step: played.append(actions) or step(actions)
    work.envs.step(np.repeat(meant, 2, axis=0))
    assert len(played) == settings.hold
    np.testing.assert_allclose(played[0][0], acted[0], atol=1e-4)
    work.envs.close()


def test_training_of_grasps_goes_on_to_the_same_bits(tmp_path):
    settings = settings_of("ppo", control_mode="grasp", hold=3, episode_steps=12, noise="rollout")
    whole = goes_on_to_the_same_bits(partial(PolicyTraining, settings=settings), tmp_path)
    assert [row["steps"] for row in whole.curve] == [24, 48, 72]


def test_a_rate_that_follows_the_divergence_goes_on_to_the_same_bits(tmp_path):
    def rates(divergence):
        settings = settings_of("ppo", adaptive=True, divergence=divergence)
        whole = goes_on_to_the_same_bits(
            partial(PolicyTraining, settings=settings), tmp_path / str(divergence)
        )
        return [row["rate"] for row in whole.curve]

    # Two updates a round: the second one knows of the first.
    np.testing.assert_allclose(rates(10.0), 3e-4 * 1.5 ** np.arange(1, 4))
    np.testing.assert_allclose(rates(1e-9), 3e-4 / 1.5 ** np.arange(1, 4))


def test_a_grasp_is_a_few_points_of_the_grasp_space():
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", control_mode="ee_delta")
    firsts, _ = env.reset(seed=1)
    observations = {key: value[None] for key, value in firsts.items()}
    space = GraspSpace(env.unwrapped.settings.cell.robot, observations)
    opened, closed = [-1.0, -1.0], [1.0, 1.0]
    above, at, lifted = ([0.2, -0.56, height, 0.0, 0.5] for height in (0.3, -0.5, 1.0))
    phases = [(above + opened, 32), (at + opened, 24), (at + closed, 28), (lifted + closed, 90)]
    for action, steps in phases:
        for _ in range(steps):
            observation, *_, info = env.step(space.carried_out(np.array([action]), observations)[0])
            observations = {key: value[None] for key, value in observation.items()}
        if action[5:] == opened:
            np.testing.assert_allclose(space.look(observations)[0], action, atol=0.2)
    assert info["is_success"]


def test_a_correction_begins_at_the_clone(tmp_path, clone):
    settings = settings_of("ppo")
    work = PolicyTraining(tmp_path, settings, clone)
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


def test_clones_of_clouds_are_refused(tmp_path, clone):
    about, arrays = read_policy(clone)
    write_policy(clone, about | {"env": {"obs_mode": "state", "control_mode": "joint_position"}}, arrays)
    assert make_agent(str(clone))
    with refused("clone another"):
        PolicyTraining(tmp_path / "out", settings_of("ppo"), clone).run()
