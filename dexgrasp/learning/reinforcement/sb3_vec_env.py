"""Adapter of the native vector environment to Stable-Baselines3."""

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from dexgrasp_env.arrays import AnyArray
from dexgrasp_env.errors import unknown_name
from dexgrasp_env.tasks.infos import of_one


class SB3VecEnv(VecEnv):
    """Vector environment of `gym.make_vec` for SB3's algorithms: terminal observations and time limits are in infos.

    env = SB3VecEnv("DexGrasp/Lift-v2", num_envs=16, objects="sugar_box")
    PPO("MultiInputPolicy", env).learn(1_000_000)
    """

    def __init__(
        self, env_id: str, num_envs: int, info_columns: Sequence[str] | None = None, **kwargs: Any
    ) -> None:
        """Make the environment.

        Args:
            env_id: of an environment that has a native vector environment.
            num_envs: number of environments.
            info_columns: keys of the infos that steps pass on; None for all, which is slow for thousands.
            **kwargs: more arguments of `gym.make_vec`.
        """
        self.envs: Any = gym.make_vec(env_id, num_envs=num_envs, **{"autoreset_mode": "SameStep", **kwargs})
        self._actions: Any = None
        self._info_columns = info_columns
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self) -> Any:
        """Start all episodes, with the seeds and options set before; infos are in `reset_infos`."""
        # Of options that are given for all, `set_options` makes one copy.
        several = any(self._options) and len({id(options) for options in self._options}) > 1
        self.envs.reset(seed=self._seeds, options=None if several else self._options[0])
        for i, options in enumerate(self._options if several else ()):
            self.envs.members[i].reset(seed=self._seeds[i], options=options)
        observation, infos = self.envs.observe()
        self.reset_infos = [of_one(infos, i) for i in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: AnyArray) -> None:
        """Store the actions."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Advance all environments by a control step."""
        observation, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        done = terminated | truncated
        for name in set(self._info_columns or ()) - infos.keys():
            raise unknown_name("name of info_columns", name, infos)
        passed = infos if self._info_columns is None else {key: infos[key] for key in self._info_columns}
        rows = [of_one(passed, i) for i in range(self.num_envs)]
        for i in np.flatnonzero(done).tolist():
            self.reset_infos[i] = rows[i]
            rows[i] = of_one(infos["final_info"], i) | {
                "terminal_observation": infos["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
            }
        return observation, rewards.astype(np.float32), done, rows

    def close(self) -> None:
        """Free the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of each environment of `indices`; see `LiftVectorEnv.get_attr`."""
        return [getattr(member, attr_name) for member in self._members(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set a user attribute of each environment of `indices`."""
        for member in self._members(indices):
            member.set(attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of each environment of `indices`; see `LiftVectorEnv.call`."""
        return [getattr(member, method_name)(*args, **kwargs) for member in self._members(indices)]

    def _members(self, indices: Any) -> list[Any]:
        """Return the environments of `indices`."""
        return [self.envs.members[i] for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for each: nothing wraps the simulations singly."""
        return [False] * len(self._members(indices))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a picture of each environment, None for each without a `render_mode`."""
        return list(self.envs.render()) if self.render_mode else [None] * self.num_envs
