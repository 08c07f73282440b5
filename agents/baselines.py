"""Baselines that ignore the observation: what a policy has to beat."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from dexgrasp.agent import BY_STATE, Agent, Info, Observation
from dexgrasp_env.arrays import Fields, Single
from dexgrasp_env.tasks.control import ONCE_MODES

_GRASPS = {
    "grasp_once": (0.2, -0.56, -0.86, 0.0, 0.5, 1.0, 1.0),  # chosen on the sugar box
    "table_grasp_once": (0.0, 0.0, -0.9, 0.0, 0.5, 1.0, 1.0),  # the middle of the table
}


class ConstantAgent(Agent):
    """One whole grasp, the same of every object.

    Where an environment's own actions are whole grasps, it acts by these; elsewhere by `grasp_once`, whose low level
    knows where the object is.
    """

    env_settings = {"obs_mode": "state", "control_mode": "grasp_once"}  # noqa: RUF012  (as the others have it)

    def settings_in(self, preset: Mapping[str, Any]) -> Fields:
        """Return its `env_settings` in an environment of some preset."""
        own = preset.get("control_mode")
        return self.env_settings | ({"control_mode": own} if own in ONCE_MODES else {})

    def reset(self, observation: Observation, info: Info) -> None:
        """Look at nothing but how it is to act."""
        self._grasp = np.array(_GRASPS[info.get("control_mode", "grasp_once")], np.float32)

    def act(self, observation: Observation) -> Single:
        """Return the grasp."""
        return self._grasp.copy()


class RandomAgent(Agent):
    """Draws every action evenly from the action space."""

    env_settings = BY_STATE

    def __init__(self) -> None:
        self._rng = np.random.default_rng()
        self._space = spaces.Box(-1.0, 1.0, (23,), np.float32)

    def seed(self, seed: int) -> None:
        """Seed the draws."""
        self._rng = np.random.default_rng(seed)

    def reset(self, observation: Observation, info: Info) -> None:
        """Take the action space from `info`; one of 23 numbers in [-1, 1] without."""
        self._space = info.get("action_space", self._space)

    def act(self, observation: Observation) -> Single:
        """Draw an action."""
        return self._rng.uniform(self._space.low, self._space.high).astype(np.float32)
