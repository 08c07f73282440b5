"""Policies of reinforcement learning in numpy: from the features of the environment to an action."""

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.learning.imitation.policy import Mlp, Policy
from dexgrasp.runs.weights import Weights, relu
from dexgrasp_env.arrays import Fields, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell


class RlPolicy(Policy):
    """Mean action of an algorithm of Stable-Baselines3; has no state within an episode."""

    kind = "features"

    def _read(self, about: Fields, arrays: Weights) -> bool:
        # Networks and action distributions are those of Stable-Baselines3's `MlpPolicy`s.
        self._squashed = about["algorithm"] == "sac"
        self._actor = Mlp(arrays, "actor", relu if self._squashed else np.tanh)
        return True

    def begin(self, first: Observation, cell: Cell) -> "RlPolicy":
        """Start an episode.

        Raises:
            InputError: for another number of features than in training.
        """
        seen = np.asarray(first).shape
        if seen != (self._actor.inputs,):
            raise InputError(f"the policy was trained on {self._actor.inputs} features: here are {seen}")
        return self

    def action(self, observation: Observation) -> Single:
        """Return the action for features (F,)."""
        x = self._actor(np.asarray(observation, np.float32))
        return np.tanh(x) if self._squashed else np.clip(x, -1.0, 1.0)
