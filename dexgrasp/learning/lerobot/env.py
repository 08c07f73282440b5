"""Environment in LeRobot's layout: `agent_pos`, `environment_state`, `pixels`, and a task description."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.wrappers import TransformObservation

from dexgrasp.data.demonstrations.lerobot_format import lerobot_observation, task_of
from dexgrasp.evaluation.protocol import trial_seeds
from dexgrasp_env.arrays import Fields
from dexgrasp_env.objects.load import object_name

OBS_TYPES = {
    "environment_state_agent_pos": "state",
    "pixels_agent_pos": "rgbd",
    "pixels_environment_state_agent_pos": "state+rgbd",
}
"""Kind of observations, as LeRobot calls them -> `obs_mode`."""


class LeRobotEnv(TransformObservation[Any, Any, Any]):
    """Environment of one object under one protocol; a seed is the number of a trial of `dexgrasp evaluate`.

    Attributes:
        task: name of the object.
        task_description: in words, as in demonstrations.
    """

    def __init__(self, env: gym.Env[Any, Any], target: str, seed: int = 0) -> None:
        """Wrap an environment.

        Args:
            env: of one object.
            target: the object, as `gym.make` takes it.
            seed: of the evaluation whose scenes are used.
        """
        super().__init__(
            env, lerobot_observation, _space(lerobot_observation(env.observation_space.sample()))
        )
        self._target, self._evaluation_seed = target, seed
        self.task = object_name(target)
        self.task_description = task_of(self.task)
        self._max_episode_steps = env.spec and env.spec.max_episode_steps

    def reset(self, *, seed: int | None = None, options: Fields | None = None) -> tuple[Fields, Fields]:
        """Start the scene of trial `seed`; None for any scene."""
        scene = None if seed is None else trial_seeds(self._evaluation_seed, self._target, int(seed)).scene
        observation, info = super().reset(seed=scene, options=options)
        return observation, _passed_on(info)

    def step(self, action: Any) -> tuple[Fields, Any, bool, bool, Fields]:
        """Advance; an episode ends with success, as a trial does."""
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, reward, terminated or info["is_success"], truncated, _passed_on(info)

    def render(self) -> Any:
        """Return a picture; a small black one without a `render_mode`, as `lerobot-eval` always films."""
        return np.zeros((64, 64, 3), np.uint8) if self.render_mode is None else self.env.render()


def _passed_on(info: Fields) -> Fields:
    return {key: info[key] for key in ("is_success", "is_grasped", "object", "stage", "failure")}


def _space(seen: Any) -> spaces.Space[Any]:
    """Return the space of an observation: any numbers, or colours."""
    if isinstance(seen, dict):
        return spaces.Dict({key: _space(part) for key, part in seen.items()})
    low, high = (0, 255) if seen.dtype == np.uint8 else (-np.inf, np.inf)
    return spaces.Box(low, high, seen.shape, seen.dtype)
