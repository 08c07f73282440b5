"""What an agent is: anything with these members can be evaluated beside the planners."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

Observation = Mapping[str, NDArray[Any]]


@dataclass
class Report:
    """What an agent says of its plan; evaluation writes it beside the outcome.

    Attributes:
        failure: why it has no plan, in a few words that can be counted, or None.
        again: whether it may yet have one: it acts, looks again and plans once more.
        planning_seconds: time from the observation to the plan; None for agents that do not plan.
        details: anything JSON can hold: the grasp, its certificate, counts of proposals.
    """

    failure: str | None = None
    again: bool = False
    planning_seconds: float | None = None
    details: dict[str, Any] = field(default_factory=dict)


class Agent(ABC):
    """A policy of the environment.

    Subclasses say which environment settings they need; evaluation makes the environment with them. An agent sees the
    observation and, at reset, the public part of `info`: nothing of the object's pose unless its `obs_mode` is `state`.
    """

    env_settings: ClassVar[Mapping[str, Any]] = {}
    """Keyword arguments of `gym.make` that this agent needs, e.g. obs_mode and control_mode."""

    @cached_property
    def report(self) -> Report:
        """Filled in by `reset`, or set to another one there."""
        return Report()

    def seed(self, seed: int) -> None:  # noqa: B027  (agents without randomness need not override it)
        """Seed the agent's own randomness; called before every episode's `reset`."""

    @abstractmethod
    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Start an episode: plan, or forget.

        Args:
            observation: the first observation.
            info: the public info: action_space, control_period (s), mount, modes, when cameras look (observe).
        """

    @abstractmethod
    def act(self, observation: Observation) -> NDArray[np.float32]:
        """Return the next action, within the environment's action space."""
