"""Environments as the algorithms see them: features of the state, and a clone that acts along."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from dexgrasp.imitation.features import Observation
from dexgrasp.imitation.policy import Scaling
from dexgrasp.reinforcement.actor import Acting, Eye


class FeatureVecEnv(VecEnvWrapper):
    """Gives what an `Actor`'s network is given, and carries out what an `Actor` would."""

    def __init__(self, envs: VecEnv, acting: Acting) -> None:
        """Wrap environments of `obs_mode="state"`."""
        width = np.size(acting.scaling.mean) + (acting.clone.joints if acting.clone else 0)
        super().__init__(envs, observation_space=spaces.Box(-np.inf, np.inf, (width,), np.float32))
        self._acting, self._cell = acting, envs.get_attr("settings")[0].cell
        self._eyes: list[Eye] = []
        self._returns = np.zeros(self.num_envs)
        self.finished: list[tuple[float, bool]] = []

    def reset(self) -> NDArray[np.float32]:
        """Start all episodes."""
        observations: Any = self.venv.reset()
        firsts = [one(observations, i) for i in range(self.num_envs)]
        self._eyes = [Eye(self._acting, first, self._cell) for first in firsts]
        self._returns[:] = 0.0
        self.finished.clear()
        return self._looks(firsts)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Pass on what is carried out."""
        clipped = np.clip(actions, -1.0, 1.0)
        whole = [eye.carried_out(action) for eye, action in zip(self._eyes, clipped, strict=True)]
        self.venv.step_async(np.stack(whole))

    def step_wait(self) -> Any:
        """Advance all; what ended is counted in `finished` as return and success."""
        observations: Any
        observations, rewards, dones, infos = self.venv.step_wait()
        self._returns += rewards
        seen = [one(observations, i) for i in range(self.num_envs)]
        for i in np.flatnonzero(dones).tolist():
            self.finished.append((float(self._returns[i]), bool(infos[i]["is_success"])))
            infos[i]["terminal_observation"] = self._eyes[i].look(infos[i]["terminal_observation"])
            self._eyes[i], self._returns[i] = Eye(self._acting, seen[i], self._cell), 0.0
        return self._looks(seen), rewards, dones, infos

    def _looks(self, seen: Sequence[Observation]) -> NDArray[np.float32]:
        return np.stack([eye.look(observation) for eye, observation in zip(self._eyes, seen, strict=True)])


def one(observations: Observation, i: int) -> Observation:
    """Return the observation of environment `i`."""
    return {key: values[i] for key, values in observations.items()}


def measure(envs: VecEnv, steps: int, rng: np.random.Generator) -> Scaling:
    """Return mean and spread (F,) of the features under random actions; spreads are at least 0.1."""
    seen = FeatureVecEnv(envs, Acting(Scaling(0.0, 1.0), None, 1.0))
    looks: list[Any] = [seen.reset()]
    for _ in range(steps - 1):
        looks.append(seen.step(rng.uniform(-1.0, 1.0, (envs.num_envs, *(envs.action_space.shape or ()))))[0])
    table = np.concatenate(looks).astype(float)
    return Scaling(table.mean(axis=0), np.maximum(table.std(axis=0), 0.1))
