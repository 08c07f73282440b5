"""Environments as the algorithms see them: features of the state, and a clone that acts along."""

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from dexgrasp.learning.imitation.policy import Scaling
from dexgrasp.learning.reinforcement.actor import Acting, Eyes, one
from dexgrasp.learning.reinforcement.grasp_space import SIZE
from dexgrasp_env.arrays import Single


class FeatureVecEnv(VecEnvWrapper):
    """Gives what an `Actor`'s network is given, and carries out what an `Actor` would."""

    def __init__(
        self,
        envs: VecEnv,
        acting: Acting,
        reward_scale: float = 1.0,
        discount: float = 1.0,
        ends: bool = False,
        farthest: float = 1.0,
    ) -> None:
        """Wrap environments.

        Args:
            envs: of `obs_mode="state"`.
            acting: how answers become actions.
            reward_scale: factor on rewards.
            discount: of a reward an answer later; of those within it, by as much as they are later.
            ends: the time limit is an end, as of the task, behind which there is nothing to be had.
            farthest: that a number of an answer may be from 0.
        """
        width = np.size(acting.scaling.mean) + (acting.clone.joints if acting.clone else 0)
        size = SIZE if acting.grasps else int(np.prod(envs.action_space.shape or ()))
        actions = spaces.Box(-farthest, farthest, (acting.chunk * size,), np.float32)
        super().__init__(envs, spaces.Box(-np.inf, np.inf, (width,), np.float32), actions)
        self._acting, self._cell = acting, envs.get_attr("settings")[0].cell
        self._ends, self._farthest = ends, farthest
        self._scales = reward_scale * discount ** (np.arange(acting.span) / acting.span)
        self._eyes: Eyes | None = None
        self._now: Any = {}
        self._answers = np.zeros(0)
        self._returns = np.zeros(self.num_envs)
        self.finished: list[tuple[float, bool]] = []

    def reset(self) -> Single:
        """Start all episodes."""
        self._now = self.venv.reset()
        self._eyes = Eyes(self._acting, self._now, self._cell)
        self._returns[:] = 0.0
        self.finished.clear()
        return self._eyes.look(self._now)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Note the network's answers."""
        self._answers = np.clip(actions, -self._farthest, self._farthest)

    def step_wait(self) -> Any:
        """Carry the answers out for as long as they stand; what ended is counted in `finished` as return and success.

        Who begins anew meanwhile goes on with the answer that stood, for which it gets no reward.
        """
        eyes = self._eyes
        assert eyes
        rewards, ended = np.zeros(self.num_envs, np.float32), np.zeros(self.num_envs, bool)
        told: list[Any] = []
        for step in range(self._acting.span):
            actions = eyes.carried_out(self._acting.action(self._answers, step), self._now)
            self._now, gained, dones, infos = self.venv.step(actions)
            told = [
                before if over else info
                for before, over, info in zip(told or infos, ended, infos, strict=True)
            ]
            self._returns += gained
            rewards += np.where(ended, 0.0, self._scales[step] * gained)
            for i in np.flatnonzero(dones).tolist():
                info = infos[i]
                self.finished.append((float(self._returns[i]), bool(info["is_success"])))
                info["terminal_observation"] = eyes.last(i, info["terminal_observation"])
                info["TimeLimit.truncated"] &= not self._ends
                eyes.begin(i, one(self._now, i))
                self._returns[i] = 0.0
            ended |= dones
        return eyes.look(self._now), rewards, ended, told


def measure(envs: VecEnv, acting: Acting, steps: int, rng: np.random.Generator) -> Scaling:
    """Return mean and spread (F,) of the features under random actions; spreads are at least 0.1."""
    seen = FeatureVecEnv(envs, acting._replace(scaling=Scaling(0.0, 1.0)))
    looks: list[Any] = [seen.reset()]
    for _ in range(steps - 1):
        looks.append(seen.step(rng.uniform(-1.0, 1.0, (envs.num_envs, *(seen.action_space.shape or ()))))[0])
    table = np.concatenate(looks).astype(float)
    return Scaling(table.mean(axis=0), np.maximum(table.std(axis=0), 0.1))
