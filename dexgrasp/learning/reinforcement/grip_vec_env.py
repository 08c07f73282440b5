"""Whole episodes as single steps: a correction of the grip in, the episode's return out."""

from typing import Any

import numpy as np
from gymnasium import spaces

from dexgrasp.learning.imitation.bc_policy import BcPolicy
from dexgrasp.learning.reinforcement.grip_policy import GRIP_SIZE, GripRun, first_features
from dexgrasp.learning.reinforcement.rl_policy import one
from dexgrasp.learning.reinforcement.sb3_vec_env import SB3VecEnv
from dexgrasp_env.arrays import Array, Mask, Single

_WEIGHTS = {"reach": 0.2, "contact": 0.2, "lift": 0.3, "hold": 0.3}
"""Of the terms whose mean over the control steps is an episode's return: early and firm holds earn more."""


class GripVecEnv(SB3VecEnv):
    """Environments in which a clone acts, and an action is the correction of its grip for an episode.

    All episodes have the same length; one that ends before, its object lost, earns nothing more. Groups of environments
    begin alike, and the reward is by how much an episode's return (the mean over its control steps) is above its
    group's: what scene, friction and mass make of it falls out, what the correction makes of it stays.
    """

    def __init__(self, env_id: str, num_envs: int, clone: BcPolicy, group_size: int, **kwargs: Any) -> None:
        """Make the environments.

        Args:
            env_id: of one that has a native vector environment.
            num_envs: how many, a multiple of `group_size`.
            clone: that acts.
            group_size: environments that begin alike.
            **kwargs: more arguments of `gym.make_vec`; `max_episode_steps` is the episodes' length.
        """
        super().__init__(env_id, num_envs, autoreset_mode="Disabled", **kwargs)
        self.observation_space = spaces.Box(-np.inf, np.inf, clone.scaling.mean.shape, np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (GRIP_SIZE,), np.float32)
        self._clone = clone
        self._cell = self.get_attr("settings")[0].cell
        self._length, self._group_size = int(kwargs["max_episode_steps"]), group_size
        self._rng = np.random.default_rng()
        self._now: Any = {}
        self.finished: list[tuple[float, bool]] = []

    def reset(self) -> Single:
        """Start all episodes; `finished` then holds return, and whether the object is held at the end, of each."""
        self.finished.clear()
        if self._seeds[0] is not None:
            self._rng = np.random.default_rng(self._seeds[0])
        self._reset_seeds()
        self._begin()
        return self._looks()

    def _begin(self) -> None:
        seeds = self._rng.integers(2**31, size=self.num_envs // self._group_size)
        self._now, _ = self.envs.reset(seed=np.repeat(seeds, self._group_size).tolist())

    def step_wait(self) -> Any:
        """Play the episodes to their end and begin the next."""
        infos = [{"terminal_observation": last} for last in self._looks()]
        returns, held = self._play()
        self.finished += zip(returns.tolist(), held.tolist(), strict=True)
        groups = returns.reshape(-1, self._group_size)
        rewards = (groups - groups.mean(axis=1, keepdims=True)).ravel()
        self._begin()
        return self._looks(), rewards.astype(np.float32), np.ones(self.num_envs, bool), infos

    def _play(self) -> tuple[Array, Mask]:
        runs = [
            GripRun(self._clone, one(self._now, i), correction, self._cell)
            for i, correction in enumerate(np.clip(self._actions, -1.0, 1.0).astype(float))
        ]
        now, running = self._now, np.ones(self.num_envs, bool)
        returns, held = np.zeros(self.num_envs), np.zeros(self.num_envs, bool)
        for _ in range(self._length):
            actions = np.stack([run.action(one(now, i)) for i, run in enumerate(runs)])
            now, _, terminated, _, infos = self.envs.step(actions)
            running &= ~terminated
            terms = infos["reward_terms"]
            returns[running] += sum(weight * terms[name] for name, weight in _WEIGHTS.items())[running]
            held = (infos["held_seconds"] > 0.0) & running
            if terminated.any():  # they go on with another object, uncounted
                now, _ = self.envs.reset(options={"reset_mask": terminated})
        return returns / self._length, held

    def _looks(self) -> Single:
        return np.stack([first_features(self._clone, one(self._now, i)) for i in range(self.num_envs)])
