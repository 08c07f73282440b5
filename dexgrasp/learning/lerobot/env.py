"""Environment in LeRobot's layout: `agent_pos`, `environment_state`, `pixels`, and a task description."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from dexgrasp.agent import Observation
from dexgrasp.data.demonstrations.lerobot_format import object_keys, task_of
from dexgrasp.evaluation.protocol import trial_seeds
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import unknown_name
from dexgrasp_env.objects.load import object_name

OBS_TYPES = {
    "environment_state_agent_pos": "state",
    "pixels_agent_pos": "rgbd",
    "pixels_environment_state_agent_pos": "state+rgbd",
}
"""Kind of observations, as LeRobot calls them -> `obs_mode`."""


def obs_mode_of(obs_type: str) -> str:
    """Return the `obs_mode` for LeRobot's `obs_type`.

    Raises:
        InputError: naming the valid ones.
    """
    if obs_type not in OBS_TYPES:
        raise unknown_name("obs_type", obs_type, OBS_TYPES)
    return OBS_TYPES[obs_type]


def lerobot_observation(observation: Observation) -> Fields:
    """Return an observation, or a batch of them, in LeRobot's layout.

    `agent_pos` (..., n) joints rad; `environment_state` (..., 17) mass kg, pose, size m, velocity of the object where
    the state is seen; `pixels` by view, (..., H, W, 3) uint8, where colours are.
    """
    seen: Fields = {"agent_pos": observation["joint_positions"]}
    if keys := object_keys(observation):
        seen["environment_state"] = np.concatenate([observation[key] for key in keys], axis=-1)
    if "rgb" in observation:
        pictures = np.moveaxis(observation["rgb"], -4, 0)
        seen["pixels"] = {f"view_{k}": picture for k, picture in enumerate(pictures)}
    return seen


class LeRobotEnv(gym.Wrapper[Any, Any, Any, Any]):
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
        super().__init__(env)
        self._target, self._evaluation_seed = target, seed
        self.task = object_name(target)
        self.task_description = task_of(self.task)
        self._max_episode_steps = env.spec and env.spec.max_episode_steps
        self.observation_space = _space(env.observation_space)

    def reset(self, *, seed: int | None = None, options: Fields | None = None) -> tuple[Fields, Fields]:
        """Start the scene of trial `seed`; None for any scene."""
        scene = None if seed is None else trial_seeds(self._evaluation_seed, self._target, int(seed)).scene
        observation, info = self.env.reset(seed=scene, options=options)
        return lerobot_observation(observation), _passed_on(info)

    def step(self, action: Any) -> tuple[Fields, float, bool, bool, Fields]:
        """Advance; an episode ends with success, as a trial does."""
        observation, reward, terminated, truncated, info = self.env.step(np.asarray(action, dtype=np.float64))
        over = terminated or bool(info["is_success"])
        return lerobot_observation(observation), float(reward), over, truncated, _passed_on(info)

    def render(self) -> Any:
        """Return a picture; a small black one without a `render_mode`, as `lerobot-eval` always films."""
        return np.zeros((64, 64, 3), np.uint8) if self.render_mode is None else self.env.render()


def _passed_on(info: Fields) -> Fields:
    return {key: info[key] for key in ("is_success", "is_grasped", "object", "stage", "failure")}


def _space(space: Any) -> spaces.Dict:
    seen: Fields = {"agent_pos": space["joint_positions"]}
    if keys := object_keys(space):
        size = sum(space[key].shape[0] for key in keys)
        seen["environment_state"] = spaces.Box(-np.inf, np.inf, (size,), np.float32)
    if "rgb" in space.spaces:
        count, *shape = space["rgb"].shape
        seen["pixels"] = spaces.Dict(
            {f"view_{k}": spaces.Box(0, 255, tuple(shape), np.uint8) for k in range(count)}
        )
    return spaces.Dict(seen)
