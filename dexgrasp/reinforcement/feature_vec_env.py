"""Environments as the algorithms see them: features of the state, and a clone that acts along."""

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from dexgrasp.imitation.policy import Scaling
from dexgrasp.reinforcement.actor import Acting, Eyes, one


class FeatureVecEnv(VecEnvWrapper):
    """Gives what an `Actor`'s network is given, and carries out what an `Actor` would."""

    def __init__(self, envs: VecEnv, acting: Acting) -> None:
        """Wrap environments of `obs_mode="state"`."""
        width = np.size(acting.scaling.mean) + (acting.clone.joints if acting.clone else 0)
        super().__init__(envs, observation_space=spaces.Box(-np.inf, np.inf, (width,), np.float32))
        self._acting, self._cell = acting, envs.get_attr("settings")[0].cell
        self._eyes: Eyes | None = None
        self._returns = np.zeros(self.num_envs)
        self.finished: list[tuple[float, bool]] = []

    def reset(self) -> NDArray[np.float32]:
        """Start all episodes."""
        observations: Any = self.venv.reset()
        self._eyes = Eyes(self._acting, observations, self._cell)
        self._returns[:] = 0.0
        self.finished.clear()
        return self._eyes.look(observations)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Pass on what is carried out."""
        assert self._eyes is not None
        self.venv.step_async(self._eyes.carried_out(np.clip(actions, -1.0, 1.0)))

    def step_wait(self) -> Any:
        """Advance all; what ended is counted in `finished` as return and success."""
        observations: Any
        observations, rewards, dones, infos = self.venv.step_wait()
        self._returns += rewards
        eyes = self._eyes
        assert eyes is not None
        for i in np.flatnonzero(dones).tolist():
            self.finished.append((float(self._returns[i]), bool(infos[i]["is_success"])))
            infos[i]["terminal_observation"] = eyes.last(i, infos[i]["terminal_observation"])
            eyes.begin(i, one(observations, i))
            self._returns[i] = 0.0
        return eyes.look(observations), rewards, dones, infos


def measure(envs: VecEnv, steps: int, rng: np.random.Generator) -> Scaling:
    """Return mean and spread (F,) of the features under random actions; spreads are at least 0.1."""
    seen = FeatureVecEnv(envs, Acting(Scaling(0.0, 1.0), None, 1.0))
    looks: list[Any] = [seen.reset()]
    for _ in range(steps - 1):
        looks.append(seen.step(rng.uniform(-1.0, 1.0, (envs.num_envs, *(envs.action_space.shape or ()))))[0])
    table = np.concatenate(looks).astype(float)
    return Scaling(table.mean(axis=0), np.maximum(table.std(axis=0), 0.1))
