"""The same grasp of everything: what a task of lifting gives away to an agent that looks at nothing."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from dexgrasp.agent import Agent, Observation
from dexgrasp_env.arrays import Single

_GRASP = (0.2, -0.56, -0.86, 0.0, 0.5, 1.0, 1.0)  # of the grasp space, chosen on the sugar box


class ConstantAgent(Agent):
    """One whole grasp, the same of every object: the floor of what a policy is worth."""

    env_settings = {"obs_mode": "state", "control_mode": "grasp_once"}  # noqa: RUF012  (as the others have it)

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Look at nothing."""

    def act(self, observation: Observation) -> Single:
        """Return the grasp."""
        return np.array(_GRASP, np.float32)
