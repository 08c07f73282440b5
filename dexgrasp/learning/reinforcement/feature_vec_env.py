"""Environments of a policy network: features in, outputs as actions, with a cloned policy beside it."""

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from dexgrasp.learning.imitation.policy import Scaling
from dexgrasp.learning.reinforcement.rl_policy import ActionSpec, ObservationEncoder, one
from dexgrasp_env.arrays import Single


class FeatureVecEnv(VecEnvWrapper):
    """Environments with an `RlPolicy`'s network inputs as observations and its outputs as actions."""

    def __init__(
        self,
        envs: VecEnv,
        spec: ActionSpec,
        reward_scale: float = 1.0,
        gamma: float = 1.0,
        ends: bool = False,
        farthest: float = 1.0,
    ) -> None:
        """Wrap environments.

        Args:
            envs: of `obs_mode="state"`.
            spec: the way from outputs to actions.
            reward_scale: factor on rewards.
            gamma: discount of a reward one output later; within an output in proportion.
            ends: the time limit ends an episode as the task would: no value beyond it.
            farthest: largest number of an output.
        """
        width = np.size(spec.scaling.mean) + (spec.clone.joints if spec.clone else 0)
        size = int(np.prod(envs.action_space.shape or ()))
        actions = spaces.Box(-farthest, farthest, (spec.action_chunk * size,), np.float32)
        super().__init__(envs, spaces.Box(-np.inf, np.inf, (width,), np.float32), actions)
        self._spec, self._cell = spec, envs.get_attr("settings")[0].cell
        self._ends, self._farthest = ends, farthest
        self._scales = reward_scale * gamma ** (np.arange(spec.span) / spec.span)
        self._encoder: ObservationEncoder | None = None
        self._now: Any = {}
        self._outputs = np.zeros(0)
        self._returns = np.zeros(self.num_envs)
        self.finished: list[tuple[float, bool]] = []

    def reset(self) -> Single:
        """Start all episodes."""
        self._now = self.venv.reset()
        self._encoder = ObservationEncoder(self._spec, self._now, self._cell)
        self._returns[:] = 0.0
        self.finished.clear()
        return self._encoder.encode(self._now)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the network's outputs."""
        self._outputs = np.clip(actions, -self._farthest, self._farthest)

    def step_wait(self) -> Any:
        """Carry the outputs out; add return and success of each episode that ends to `finished`.

        An environment that begins anew meanwhile goes on with the same output and gets no reward for it.
        """
        encoder = self._encoder
        assert encoder
        rewards, ended = np.zeros(self.num_envs, np.float32), np.zeros(self.num_envs, bool)
        told: list[Any] = []
        for step in range(self._spec.span):
            actions = encoder.env_actions(self._spec.action(self._outputs, step))
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
                info["terminal_observation"] = encoder.encode_last(i, info["terminal_observation"])
                info["TimeLimit.truncated"] &= not self._ends
                encoder.begin(i, one(self._now, i))
                self._returns[i] = 0.0
            ended |= dones
        return encoder.encode(self._now), rewards, ended, told


def measure(envs: VecEnv, spec: ActionSpec, steps: int, rng: np.random.Generator) -> Scaling:
    """Return mean and spread (F,) of the features under random actions; spreads are at least 0.1."""
    seen = FeatureVecEnv(envs, spec._replace(scaling=Scaling(0.0, 1.0)))
    looks: list[Any] = [seen.reset()]
    for _ in range(steps - 1):
        looks.append(seen.step(rng.uniform(-1.0, 1.0, (envs.num_envs, *(seen.action_space.shape or ()))))[0])
    table = np.concatenate(looks).astype(float)
    return Scaling(table.mean(axis=0), np.maximum(table.std(axis=0), 0.1))
