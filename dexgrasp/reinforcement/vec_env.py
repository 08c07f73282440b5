"""Environments as the algorithms see them: features of the state, and a clone that acts along."""

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from dexgrasp.imitation.clone import Clone, CloneRun
from dexgrasp.imitation.features import Scene, first_look
from dexgrasp.reinforcement.actor import combined, network_input
from dexgrasp_env.arrays import Array

Observations = dict[str, NDArray[Any]]


class FeatureVecEnv(VecEnvWrapper):
    """Gives what an `Actor`'s network is given, and carries out what an `Actor` would."""

    def __init__(self, envs: VecEnv, scaling: tuple[Array, Array], clone: Clone | None, share: float) -> None:
        """Wrap environments of `obs_mode="state"`.

        Args:
            envs: with dict observations.
            scaling: mean and spread (F,) of the features.
            clone: that acts along, or None.
            share: of the network's action on the clone's.
        """
        width = len(scaling[0]) + (0 if clone is None else 23)
        space = spaces.Box(-np.inf, np.inf, (width,), np.float32)
        super().__init__(envs, observation_space=space)
        self._scaling, self._clone, self._share = scaling, clone, share
        self._scenes: list[Scene | None] = [None] * self.num_envs
        self._runs: list[CloneRun | None] = [None] * self.num_envs
        self._clones: list[Array | None] = [None] * self.num_envs
        self._steps = np.zeros(self.num_envs, int)
        self._returns = np.zeros(self.num_envs)
        self.finished: list[tuple[float, bool]] = []

    def reset(self) -> NDArray[np.float32]:
        """Start all episodes."""
        observations: Any = self.venv.reset()
        self.finished.clear()
        return np.stack([self._begin(i, _one(observations, i)) for i in range(self.num_envs)])

    def step_async(self, actions: NDArray[Any]) -> None:
        """Pass on what is carried out."""
        whole = [
            combined(np.clip(action, -1.0, 1.0), clones, self._share)
            for action, clones in zip(actions, self._clones, strict=True)
        ]
        self.venv.step_async(np.stack(whole))

    def step_wait(self) -> Any:
        """Advance all; what ended is counted in `finished` as return and success."""
        observations: Any
        observations, rewards, dones, infos = self.venv.step_wait()
        self._returns += rewards
        self._steps += 1
        looks = []
        for i in range(self.num_envs):
            now = _one(observations, i)
            if dones[i]:
                self.finished.append((float(self._returns[i]), bool(infos[i]["is_success"])))
                last = infos[i]["terminal_observation"]
                infos[i]["terminal_observation"] = self._look(i, last)
                looks.append(self._begin(i, now))
            else:
                looks.append(self._look(i, now))
        return np.stack(looks), rewards, dones, infos

    def _begin(self, i: int, first: Observations) -> NDArray[np.float32]:
        self._steps[i], self._returns[i] = 0, 0.0
        self._scenes[i] = first_look("state", first)
        self._runs[i] = (
            None
            if self._clone is None
            else CloneRun(self._clone, first, self.envs.unwrapped.settings.cell.robot)
        )
        return self._look(i, first)

    def _look(self, i: int, now: Observations) -> NDArray[np.float32]:
        run, scene = self._runs[i], self._scenes[i]
        assert scene is not None
        self._clones[i] = None if run is None else run.action(now).astype(float)
        looks = network_input(self._scaling, scene, now, int(self._steps[i]), self._clones[i])
        return looks.astype(np.float32)


def _one(observations: Observations, i: int) -> Observations:
    return {key: values[i] for key, values in observations.items()}


def measure(envs: VecEnv, steps: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return mean and spread (F,) of the features under random actions; spreads are at least 0.1."""
    from dexgrasp.imitation.features import features

    observations: Any = envs.reset()
    number = envs.num_envs
    scenes = [first_look("state", _one(observations, i)) for i in range(number)]
    rows: list[Array] = []
    for step in range(steps):
        rows += [features("state", scenes[i], _one(observations, i), step) for i in range(number)]
        observations, _, dones, _ = envs.step(rng.uniform(-1.0, 1.0, (number, 23)))
        for i in np.flatnonzero(dones).tolist():
            scenes[i] = first_look("state", _one(observations, i))
    table = np.array(rows)
    return table.mean(axis=0), np.maximum(table.std(axis=0), 0.1)
