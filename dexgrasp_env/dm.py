"""The lift task as a `dm_env.Environment`, for users of that ecosystem.

env = dexgrasp_env.dm.load(objects="seen", control_mode="joint_delta")
timestep = env.reset()
timestep = env.step(action)
"""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra

with from_extra():
    import dm_env
    from dm_env import specs


def load(
    objects: str | list[str] | tuple[str, ...] = "ycb6", *, seed: int | None = None, **kwargs: Any
) -> "LiftTask":
    """Return the task of `DexGrasp/Lift-v1` as a dm_env environment.

    Args:
        objects: as for `gym.make`.
        seed: of all episodes; None draws one.
        kwargs: everything else that `gym.make("DexGrasp/Lift-v1")` accepts.

    Raises:
        InputError: if an argument is wrong.
    """
    return LiftTask(gym.make("DexGrasp/Lift-v1", objects=objects, disable_env_checker=True, **kwargs), seed)


class LiftTask(dm_env.Environment):
    """A view of a Gymnasium environment: the same simulation, observations, rewards and time limit.

    An episode that terminates ends with discount 0; one that the time limit truncates ends with discount 1, since
    its state had a future.
    """

    def __init__(self, env: gym.Env[Any, Any], seed: int | None = None) -> None:
        self._env, self._seed = env, seed
        self._running = False
        self._info: dict[str, Any] = {}

    @property
    def info(self) -> dict[str, Any]:
        """What Gymnasium's `info` says of the last step: is_success, failure, reward_terms, ..."""
        return self._info

    @property
    def gym_env(self) -> gym.Env[Any, Any]:
        """The environment that this is a view of."""
        return self._env

    def reset(self) -> dm_env.TimeStep:
        """Start an episode."""
        observation, self._info = self._env.reset(seed=self._seed)
        self._seed = None  # later episodes go on with the same generator
        self._running = True
        return dm_env.restart(observation)

    def step(self, action: NDArray[np.float32]) -> dm_env.TimeStep:
        """Advance 50 ms; after a last step the action is ignored and an episode starts, as dm_env wants it."""
        if not self._running:
            return self.reset()
        observation, reward, terminated, truncated, self._info = self._env.step(action)
        self._running = not (terminated or truncated)
        if terminated:
            return dm_env.termination(float(reward), observation)
        if truncated:
            return dm_env.truncation(float(reward), observation, discount=1.0)
        return dm_env.transition(float(reward), observation)

    def observation_spec(self) -> dict[str, specs.Array]:
        """Return a spec for every key of the observations."""
        space = self._env.observation_space
        assert isinstance(space, spaces.Dict)
        return {key: _spec(key, part) for key, part in space.items()}

    def action_spec(self) -> specs.BoundedArray:
        """Return the actions' spec: within [-1, 1]."""
        return _spec("action", self._env.action_space)

    def reward_spec(self) -> specs.BoundedArray:
        """Return the rewards' spec: within [0, 1]."""
        return specs.BoundedArray((), np.float64, 0.0, 1.0, name="reward")

    def discount_spec(self) -> specs.BoundedArray:
        """Return the discounts' spec: within [0, 1]."""
        return specs.BoundedArray((), np.float64, 0.0, 1.0, name="discount")

    def close(self) -> None:
        """Free what rendering holds."""
        self._env.close()


def _spec(name: str, space: gym.Space[Any]) -> Any:
    if isinstance(space, spaces.MultiBinary):
        return specs.BoundedArray(space.shape, space.dtype, 0, 1, name=name)
    if not isinstance(space, spaces.Box):
        raise InputError(f"space {name!r} is a {type(space).__name__}: valid are Box and MultiBinary")
    if space.is_bounded():
        return specs.BoundedArray(space.shape, space.dtype, space.low, space.high, name=name)
    return specs.Array(space.shape, space.dtype, name=name)
