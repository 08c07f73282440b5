"""The same action on everything: what a task of lifting gives away to an agent that looks at nothing."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from dexgrasp.agent import Agent, Observation
from dexgrasp_env.arrays import Fields, Single
from dexgrasp_env.tasks.control import ONCE_MODES

_GRASPS = {
    "grasp_once": (0.2, -0.56, -0.86, 0.0, 0.5, 1.0, 1.0),  # chosen on the sugar box
    "table_grasp_once": (0.0, 0.0, -0.9, 0.0, 0.5, 1.0, 1.0),  # the middle of the table
}


class ConstantAgent(Agent):
    """One whole grasp, the same of every object: the floor of what a policy is worth.

    Where an environment's own actions are whole grasps, it acts by these; elsewhere by `grasp_once`, whose low level
    knows where the object is.
    """

    env_settings = {"obs_mode": "state", "control_mode": "grasp_once"}  # noqa: RUF012  (as the others have it)

    def settings_in(self, preset: Mapping[str, Any]) -> Fields:
        """Return its `env_settings` in an environment of some preset."""
        own = preset.get("control_mode")
        return self.env_settings | ({"control_mode": own} if own in ONCE_MODES else {})

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Look at nothing but how it is to act."""
        self._grasp = np.array(_GRASPS[info.get("control_mode", "grasp_once")], np.float32)

    def act(self, observation: Observation) -> Single:
        """Return the grasp."""
        return self._grasp.copy()
