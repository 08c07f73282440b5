"""Recording of a demonstration: an agent's rollout, converted and replayed; kept if the replay succeeds too."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np

from dexgrasp.agent import Env
from dexgrasp.data.demonstrations.convert import to_action, with_noise
from dexgrasp.data.demonstrations.settings import CAMERA_KEYS, ENV_ID, DemoSettings
from dexgrasp.evaluation.protocol import agent_settings, trial_seeds
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.registry import make_agent
from dexgrasp.runs.weights import below
from dexgrasp_env.arrays import Array, Arrays, Fields, Mask, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import object_name
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.scene.constants import CONTROL_STEPS
from dexgrasp_env.tasks.control import max_step

_STEPS = ("actions", "rewards", "terminations", "truncations")


Step = tuple[Single, Any]
"""A control step: the action, and what `env.step` returned."""


@dataclass
class Demonstration:
    """Demonstration of T steps.

    Attributes:
        observations: (T + 1, ...) by key.
        actions: (T, n).
        rewards: (T,).
        terminations: (T,).
        truncations: (T,).
        once: observations that do not change: those of cameras at reset.
        about: object, seeds, certificate and first successful step, as JSON.
    """

    observations: Arrays
    actions: Single
    rewards: Array
    terminations: Mask
    truncations: Mask
    once: Arrays = field(default_factory=dict)
    about: Fields = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.actions)

    def whole(self) -> Arrays:
        """Return the observations (T + 1, ...) by key; those stored once are repeated at every step."""
        still = {key: np.broadcast_to(part, (len(self) + 1, *part.shape)) for key, part in self.once.items()}
        return self.observations | still

    def arrays(self) -> Arrays:
        """Return all arrays by name, with `observations/KEY` and `once/KEY`."""
        whole = {name: getattr(self, name) for name in _STEPS}
        for part in ("observations", "once"):
            whole |= {f"{part}/{key}": array for key, array in getattr(self, part).items()}
        return whole

    @classmethod
    def of_arrays(cls, arrays: Arrays, about: Fields) -> "Demonstration":
        """Return the demonstration of `arrays()`, which may have others besides.

        Raises:
            KeyError: if some are missing.
        """
        steps: Fields = {name: arrays[name] for name in _STEPS}
        return cls(below(arrays, "observations/"), **steps, once=below(arrays, "once/"), about=about)


class _Demonstrated(gym.Wrapper[Any, Any, Any, Any]):
    """Environment of a demonstrator: noise is added to its commands, its first view and its set-points are kept."""

    rng: np.random.Generator

    def __init__(self, env: Env, noise: float) -> None:
        super().__init__(env)
        self._noise = noise

    def reset(self, **given: Any) -> tuple[Any, Fields]:
        """Start an episode."""
        self.first, info = self.env.reset(**given)
        self.path = [_targets(self)]
        return self.first, info

    def step(self, action: Any) -> Any:
        """Advance by an action with noise, which the agent may correct."""
        if self._noise:
            settings = self.get_wrapper_attr("settings")
            robot = settings.cell.robot
            drawn = self._noise * self.rng.standard_normal(robot.dof)
            action = with_noise(settings.control_mode, action, drawn, robot)
        result = self.env.step(action.astype(np.float32))
        self.path.append(_targets(self))
        return result


def record(
    settings: DemoSettings, target: str, trials: Iterable[int]
) -> Iterator[tuple[Demonstration | None, str]]:
    """Run the agent in scenes of one object, and replay in the environment of the data set what succeeds.

    Yields:
        A demonstration and "", or None and the reason of the failure.

    Raises:
        InputError: for an unknown agent, or one whose settings belong to the protocol.
    """
    agent: Any = make_agent(settings.agent)
    asked = agent_settings(settings.agent, agent)
    if (pace := asked.get("frame_skip", CONTROL_STEPS)) != CONTROL_STEPS:
        raise InputError(
            f"agent {settings.agent!r} acts every {pace} physics steps: demonstrations have {CONTROL_STEPS}"
        )
    arguments = settings.env_arguments | {"objects": [target]}
    scene = {key: arguments[key] for key in ("objects", "robot", "mount", "friction", "randomisation")}
    env = _Demonstrated(gym.make(ENV_ID, **(scene | asked), disable_env_checker=True), settings.noise)
    other = gym.make(ENV_ID, **arguments, disable_env_checker=True)
    for trial in trials:
        seeds = trial_seeds(settings.seed, target, trial)
        env.rng = np.random.default_rng([seeds.agent, 1])
        outcome, _ = run_trial(env, agent, seeds, name=settings.agent)
        episode = replay(other, seeds.scene, np.array(env.path)) if outcome.success else None
        if episode is None:
            yield None, outcome.reason or "not_replayed"
            continue
        episode.once = {key: env.first[key] for key in CAMERA_KEYS if key in env.first} | episode.once
        episode.about |= {
            "object": object_name(target), "target": target, "trial": trial, "scene_seed": seeds.scene,
            "agent_seed": seeds.agent, "certificate": outcome.details.get("certificate"), "steps": len(episode),
        }  # fmt: skip
        yield episode, ""
    env.close()
    other.close()


def intended(episode: Demonstration, noise: float, robot: Robot) -> Array:
    """Return the set-points that an agent of a joint mode intended: without the noise on its commands.

    Args:
        episode: of T steps.
        noise: standard deviation in the settings.
        robot: that moved.

    Returns:
        (T + 1, n) rad.
    """
    targets = episode.observations["joint_targets"].astype(float)
    if not noise:
        return targets
    rng = np.random.default_rng([episode.about["agent_seed"], 1])  # as it was drawn
    drawn = rng.standard_normal((len(targets) - 1, robot.dof))
    return np.concatenate([targets[:1], targets[1:] - noise * drawn * max_step(robot)])


def replay(env: Env, seed: int, path: Array) -> Demonstration | None:
    """Replay set-points (T + 1, n) in another control mode from the same scene; None without success."""
    first, _ = env.reset(seed=seed)
    actions, results = zip(*follow_set_points(env, path), strict=True)
    observations, rewards, terminated, truncated, infos = zip(*results, strict=True)
    solved = [info["is_success"] for info in infos]
    if not any(solved):
        return None
    still = CAMERA_KEYS if env.unwrapped.settings.observe == "reset" else ()  # type: ignore[attr-defined]
    moving = {key: np.stack([o[key] for o in (first, *observations)]) for key in first if key not in still}
    once = {key: np.asarray(first[key]) for key in first if key in still}
    ends = *truncated[:-1], not terminated[-1]
    rest = (np.array(part) for part in (actions, rewards, terminated, ends))
    whole: Fields = dict(zip(_STEPS, rest, strict=True))
    return Demonstration(moving, **whole, once=once, about={"solved": solved.index(True)})


def follow_set_points(env: Env, path: Array) -> Iterator[Step]:
    """Yield the steps of set-points (T + 1, n), 50 ms apart, in a running episode; the last is held for ten more."""
    settings = env.unwrapped.settings  # type: ignore[attr-defined]
    path, scale = path[:: settings.hold], settings.action_scale * settings.hold
    tree = robot_tree(settings.cell)
    for step in range(len(path) - 1 + 10):
        wanted = path[min(step + 1, len(path) - 1)]
        action = to_action(settings.control_mode, _targets(env), wanted, tree, scale)
        result = env.step(action)
        yield action, result
        if result[2] or result[3]:
            return


def _targets(env: Env) -> Array:
    return np.asarray(env.unwrapped.targets)  # type: ignore[attr-defined]
