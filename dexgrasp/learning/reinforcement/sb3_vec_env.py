"""The native vector environment as stable-baselines3 wants it."""

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp_env.arrays import Fields


class SB3VecEnv(VecEnv):
    """`gym.make_vec` with terminal observations and time-limit flags in the infos, as SB3's learners read them.

    env = SB3VecEnv("DexGrasp/Lift-v2", num_envs=16, objects="sugar_box")
    PPO("MultiInputPolicy", env).learn(1_000_000)
    """

    def __init__(self, env_id: str, num_envs: int, told: Sequence[str] | None = None, **kwargs: Any) -> None:
        """Make the environment.

        Args:
            env_id: of one that has a native vector environment.
            num_envs: how many.
            told: what of the infos is passed on at every step; None for all, which takes long for thousands.
            **kwargs: more arguments of `gym.make_vec`.
        """
        self.envs: Any = gym.make_vec(env_id, num_envs=num_envs, **{"autoreset_mode": "SameStep", **kwargs})
        self._actions: Any = None
        self._told = told
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self) -> Any:
        """Start all episodes, with what `seed` and `set_options` left for them; infos are in `reset_infos`."""
        # Of options that are given for all, `set_options` makes one copy.
        if not any(self._options) or len({id(options) for options in self._options}) == 1:
            observation, infos = self.envs.reset(seed=self._seeds, options=self._options[0])
            self.reset_infos = [self._one(infos, i) for i in range(self.num_envs)]
        else:
            observation = self._reset_singly()
        self._reset_seeds()
        self._reset_options()
        return observation

    def _reset_singly(self) -> Any:
        """Start episodes one after the other, each with its options; a mask asks for episodes to go on with."""
        observation, _ = self.envs.reset(seed=self._seeds)
        for i, options in enumerate(self._options):
            only = {"reset_mask": np.arange(self.num_envs) == i}
            observation, infos = self.envs.reset(seed=self._seeds, options=options | only)
            self.reset_infos[i] = self._one(infos, i)
        return observation

    def step_async(self, actions: NDArray[Any]) -> None:
        """Note the actions."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Advance all by 50 ms."""
        observation, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        done = terminated | truncated
        passed = infos if self._told is None else {key: infos[key] for key in self._told}
        told = [self._one(passed, i) for i in range(self.num_envs)]
        for i in np.flatnonzero(done).tolist():
            self.reset_infos[i] = told[i]
            told[i] = self._one(infos["final_info"], i) | {
                "terminal_observation": infos["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
            }
        return observation, rewards.astype(np.float32), done, told

    def _one(self, infos: Fields, i: int) -> Fields:
        """Return the infos of environment `i`, without Gymnasium's masks."""
        return {
            key: self._one(value, i) if isinstance(value, dict) else value[i]
            for key, value in infos.items()
            if not key.startswith("_") and key not in ("final_obs", "final_info")
        }

    def close(self) -> None:
        """Free the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the vector environment, once for each environment asked for."""
        value = getattr(self.envs, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the vector environment."""
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of the vector environment with each index asked for as first argument.

        `compute_reward`, which hindsight replay calls, is the same for all and gets none.
        """
        method = getattr(self.envs, method_name)
        if method_name == "compute_reward":
            return [method(*args, **kwargs) for _ in self._get_indices(indices)]
        return [method(i, *args, **kwargs) for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for each: nothing wraps the simulations singly."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a picture of each environment."""
        return list(self.envs.render() or [])
