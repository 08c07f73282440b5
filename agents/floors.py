"""Agents that look at nothing: what an environment gives away, and the floor of what a policy is worth."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from dexgrasp.agent import BY_STATE, Agent, Observation
from dexgrasp_env.arrays import Single


class ConstantAgent(Agent):
    """One whole grasp, the same of every object."""

    env_settings = {"obs_mode": "state", "control_mode": "grasp_once"}  # noqa: RUF012  (as the others have it)

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Look at nothing."""

    def act(self, observation: Observation) -> Single:
        """Return the grasp, chosen on the sugar box."""
        return np.array((0.2, -0.56, -0.86, 0.0, 0.5, 1.0, 1.0), np.float32)


class RandomAgent(Agent):
    """Draws every action evenly from the action space."""

    env_settings = BY_STATE

    def __init__(self) -> None:
        self._rng = np.random.default_rng()
        self._space = spaces.Box(-1.0, 1.0, (23,), np.float32)

    def seed(self, seed: int) -> None:
        """Seed the draws."""
        self._rng = np.random.default_rng(seed)

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Take the action space from `info`; one of 23 numbers in [-1, 1] without."""
        self._space = info.get("action_space", self._space)

    def act(self, observation: Observation) -> Single:
        """Draw an action."""
        return self._rng.uniform(self._space.low, self._space.high).astype(np.float32)
