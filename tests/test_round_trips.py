"""What is scored is what was trained: a policy's score in an evaluation is that of its training script, to the bit."""

import json
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers as gw
from refusals import refused
from tables import mistakes, table

from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.protocol import trial_seeds
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.registry import make_agent

sb3 = pytest.importorskip("stable_baselines3")
contrib = pytest.importorskip("sb3_contrib")

from stable_baselines3.common.evaluation import evaluate_policy  # noqa: E402
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecFrameStack, VecNormalize  # noqa: E402

from dexgrasp.learning.reinforcement.env_record import record_environment, save_checkpoint  # noqa: E402
from dexgrasp.learning.reinforcement.sb3_vec_env import SB3VecEnv  # noqa: E402

OBJECT, SEED, ID = "pear", 11, "DexGrasp/Lift-v2"


def dict_env(**settings):
    return gw.RecordEpisodeStatistics(gym.make(ID, objects=OBJECT, **settings))


def flat_env(**settings):
    return gw.FlattenObservation(dict_env(**settings))


def keys_env(**settings):
    return gw.FilterObservation(dict_env(**settings), ["joint_positions", "object_pose"])


def rescaled_env(**settings):
    env = flat_env(**settings)
    return gw.RescaleAction(env, np.float32(-0.25), np.full(env.action_space.shape, 0.5, np.float32))


def stacked_env(**settings):
    return gw.FrameStackObservation(gw.FlattenObservation(keys_env(**settings)), 3)


def timed_env(**settings):
    return gw.TimeAwareObservation(gw.DtypeObservation(flat_env(**settings), np.float64), normalize_time=True)


def sticky_env(**settings):
    return gw.RepeatAction(keys_env(**settings), 3)


def normalised_env(**settings):
    return gw.NormalizeObservation(flat_env(**settings))


LEARNERS = {
    kind.__name__.lower(): kind
    for kind in (sb3.A2C, sb3.PPO, sb3.SAC, sb3.TD3, contrib.TQC, contrib.RecurrentPPO, contrib.TRPO)
}
PACE = {"frame_skip": 50, "max_episode_steps": 150}
CASES = table("checkpoints")


def around(envs, how, training):
    if "normalise" in how:
        keys = ["object_pose"] if isinstance(envs.observation_space, gym.spaces.Dict) else None
        envs = VecNormalize(envs, training=training, norm_obs_keys=keys)
    return VecFrameStack(envs, 2) if "stack" in how else envs


def policy_name(space, learner):
    kind = "MultiInput" if isinstance(space, gym.spaces.Dict) else "Mlp"
    return f"{kind}{'Lstm' if learner == 'recurrentppo' else ''}Policy"


def trained(case, path, steps=64, make=DummyVecEnv):
    """Save a policy as its training script does; return what the script itself scores it with."""
    learner, wrapped, settings, how = case
    make_env = globals()[f"{wrapped}_env"]
    envs = around(make([lambda: make_env(**settings)]), how, training=True)
    name = policy_name(envs.observation_space, learner)
    model = LEARNERS[learner](name, envs, seed=3, device="cpu", **table("learners")[learner]).learn(steps)
    if model.get_vec_normalize_env():
        model.get_vec_normalize_env().training = False
    save_checkpoint(model, path)
    return model


def own_score(model, seed):
    """Return what the training script makes of one episode: return, and decisions below all wrappers."""
    envs = model.get_env()
    if "NormalizeObservation" in str(envs.envs[0]):
        envs.envs[0].set_wrapper_attr("update_running_mean", False)
    envs.seed(seed)
    evaluate_policy(model, envs, n_eval_episodes=1, warn=False)
    return envs.get_attr("return_queue")[0][-1], envs.get_attr("length_queue")[0][-1]


def scores(path, tmp_path, trials=1, **more):
    settings = EvaluationSettings.of([path], [OBJECT], trials=trials, seed=SEED, **more)
    evaluate(settings, tmp_path / "runs", progress=False)
    rows = [json.loads(line) for line in (tmp_path / "runs" / "trials.jsonl").read_text().splitlines()]
    assert not any(row["error"] for row in rows), rows[0]["error"]
    return [(row["total_reward"], row["steps"]) for row in rows]


@pytest.mark.parametrize(
    "k", [k if k < 3 else pytest.param(k, marks=pytest.mark.slow) for k in range(len(CASES))]
)
def test_an_evaluation_scores_what_the_training_script_does(k, tmp_path):
    model = trained(CASES[k], tmp_path / "policy.zip")
    found = scores(tmp_path / "policy.zip", tmp_path)
    for trial, score in enumerate(found):
        assert score == own_score(model, trial_seeds(SEED, OBJECT, trial).scene)


class Halved(gym.ActionWrapper, gym.utils.RecordConstructorArgs):
    """A user's own wrapper."""

    def __init__(self, env, factor):
        gym.utils.RecordConstructorArgs.__init__(self, factor=factor)
        gym.ActionWrapper.__init__(self, env)
        self.factor = factor

    def action(self, action):
        return self.factor * action


class Unrecorded(Halved):
    """One that does not tell its arguments: Gymnasium asks for them in vain."""

    def __init__(self, env, factor=0.5):
        super().__init__(env, factor)
        self._saved_kwargs = {"factor": lambda: factor}


def quick_ppo(envs, path, save=save_checkpoint):
    name = policy_name(envs.observation_space, "ppo")
    model = sb3.PPO(name, envs, n_steps=2, batch_size=2, device="cpu")
    save(model, path)
    return model


@pytest.mark.parametrize("kind", [Halved, Unrecorded])
@pytest.mark.filterwarnings("ignore:.*does not tell its arguments")
def test_a_wrapper_of_ones_own_runs_if_it_is_named(kind, tmp_path):
    model = quick_ppo(DummyVecEnv([lambda: kind(flat_env(**PACE), factor=0.25)]), tmp_path / "p.zip")
    flat = "gymnasium.wrappers.transform_observation.FlattenObservation()"
    with refused(f"whose code runs if you name all of them.*{kind.__name__}"):
        scores(tmp_path / "p.zip", tmp_path)
    named = (flat, f"test_round_trips.{kind.__name__}(factor=0.25)")
    assert scores(tmp_path / "p.zip", tmp_path, wrappers=named) == [
        own_score(model, trial_seeds(SEED, OBJECT, 0).scene)
    ]
    with refused("wrappers contradicts"):
        make_agent(tmp_path / "p.zip", wrappers=named[:1])


@pytest.mark.parametrize("make", [SubprocVecEnv, None])
def test_every_vector_environment_is_recorded(make, tmp_path):
    settings = {"control_mode": "ee_delta", **PACE}
    envs = SB3VecEnv(ID, 2, objects=OBJECT, **settings)
    if make:
        envs.close()
        envs = make([lambda: keys_env(**settings)] * 2, start_method="fork")
    record = json.loads(record_environment(VecNormalize(envs), tmp_path / "p.zip").read_text())
    envs.close()
    assert record["id"] == ID
    assert record["max_episode_steps"] == 150
    assert (record["env"]["frame_skip"], record["env"]["control_mode"]) == (50, "ee_delta")
    assert [each["name"].rpartition(":")[2] for each in record["wrappers"]] == ["FilterObservation"] * bool(
        make
    )
    assert record["vec_wrappers"][0]["state"].keys() >= {"object_pose"}


def test_another_environment_is_not_recorded(tmp_path):
    with refused("none of DexGrasp's"):
        record_environment(DummyVecEnv([lambda: gym.make("Pendulum-v1")]), tmp_path / "p.zip")


def test_what_contradicts_the_record_is_refused(tmp_path):
    quick_ppo(DummyVecEnv([lambda: dict_env(**PACE)]), tmp_path / "p.zip")
    path = tmp_path / "p.zip"
    with refused("frame_skip=50.*which frame_skip=25"):
        make_agent(path, env_kwargs={"frame_skip": 25})
    with refused("valid are obs_mode"):
        make_agent(path, env_kwargs=["friction=0.3"])
    assert make_agent(path, env_kwargs=["frame_skip=5e1"]).assumed == ""
    with refused("was trained with mount palm_normal: here it is fingers_along"):
        scores(path, tmp_path, mount="fingers_along")
    for words in mistakes("env_kwargs"):
        with refused("--env-kwargs 'frame_skip"):
            make_agent(path, env_kwargs=words)
    with refused("env_kwargs=.* changes nothing here: valid is a checkpoint"):
        EvaluationSettings.of(["random"], [OBJECT], env_kwargs=["frame_skip=50"])


def test_a_foreign_checkpoint_is_played_as_the_user_says(tmp_path, capsys):
    make = lambda: rescaled_env(control_mode="joint_position")  # noqa: E731
    model = quick_ppo(DummyVecEnv([make]), tmp_path / "p.zip", lambda model, path: model.save(path))
    path = tmp_path / "p.zip"
    with refused("does not tell their meaning"):
        make_agent(path)
    told = {"env_kwargs": ["control_mode=joint_position"]}
    with refused("--wrappers FlattenObservation"):
        scores(path, tmp_path, **told)
    with refused("on actions Box.-0.25, 0.5, .* here they are Box.-1.0, 1.0"):
        scores(path, tmp_path, **told, wrappers=["FlattenObservation"])
    named = ["FlattenObservation", "RescaleAction(min_action=-0.25, max_action=0.5)"]
    found = scores(path, tmp_path, **told, wrappers=named)
    assert found == [own_score(model, trial_seeds(SEED, OBJECT, 0).scene)]
    assert "says no more of what it was trained in" in capsys.readouterr().err


@pytest.mark.parametrize("word", mistakes("wrappers"))
def test_wrappers_are_read_and_never_run(word, tmp_path):
    quick_ppo(DummyVecEnv([dict_env]), tmp_path / "p.zip")
    with refused("wrapper"):
        make_agent(tmp_path / "p.zip", wrappers=[word])


def test_a_record_names_no_code_that_is_run(tmp_path):
    quick_ppo(DummyVecEnv([flat_env]), tmp_path / "p.zip")
    record = json.loads((tmp_path / "p.json").read_text())
    for name in ("antigravity:Absent", "stable_baselines3.common.utils:set_random_seed"):
        record["wrappers"][0]["name"] = name
        (tmp_path / "p.json").write_text(json.dumps(record))
        with refused("p.zip|wrapper"):
            scores(tmp_path / "p.zip", tmp_path)
    assert "antigravity" not in sys.modules
    (tmp_path / "p.json").write_text(json.dumps(record | {"schema": 9}))
    with refused("has schema 9"):
        make_agent(tmp_path / "p.zip")


def test_statistics_that_are_not_there_are_missed(tmp_path):
    envs = VecNormalize(DummyVecEnv([dict_env]), norm_obs_keys=["object_pose"])
    model = sb3.PPO("MultiInputPolicy", envs, n_steps=2, batch_size=2, device="cpu").learn(2)
    model.save(tmp_path / "p.zip")
    with refused("was trained under VecNormalize, whose counts are not beside it"):
        make_agent(tmp_path / "p.zip")
    envs.save(tmp_path / "p.pkl")
    assert "what VecNormalize counted" in make_agent(tmp_path / "p.zip").assumed


@pytest.mark.parametrize(("name", "told"), table("once_and_staged"))
def test_a_checkpoint_of_features_acts_where_it_was_trained(name, told, tmp_path):
    env = gym.make(f"DexGrasp/{name}", objects="lego")
    trained = sb3.SAC("MlpPolicy", env, device="cpu", buffer_size=10)
    trained.save(tmp_path / "sac.zip")
    agent = make_agent(tmp_path / "sac.zip")
    assert agent.env_settings == {"obs_mode": "features"} | told
    observation, _ = gym.make("DexGrasp/Lift-v2", objects="lego", **agent.env_settings).reset(seed=0)
    agent.reset(observation, {})
    np.testing.assert_array_equal(agent.act(observation), trained.predict(observation, deterministic=True)[0])
    with refused("of another control_mode"):
        agent.act(observation[:-1])
