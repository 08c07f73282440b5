"""The contract of agents: an object with these members can be evaluated beside the planners."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym

from dexgrasp_env.arrays import AnyArray, Fields, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.valid import check, instance

Env = gym.Env[Any, Any]
Observation = Mapping[str, AnyArray]
Info = Mapping[str, Any]
BY_STATE: Fields = {"obs_mode": "state", "control_mode": "joint_delta"}
BY_CLOUD: Fields = {"obs_mode": "pointcloud", "control_mode": "joint_position", "observe": "reset"}
"""`env_settings` of agents that see all, and of those that look once and command set-points."""


@dataclass
class Report:
    """An agent's account of its plan; evaluation writes it beside the outcome.

    Attributes:
        failure: why it has no plan, in a few words that can be counted, or None.
        again: whether it may yet have one: it acts, looks again and plans once more.
        planning_seconds: time from the observation to the plan; None for agents that do not plan.
        details: anything JSON can hold: the grasp, its certificate, counts of proposals.
    """

    failure: str | None = None
    again: bool = False
    planning_seconds: float | None = None
    details: Fields = field(default_factory=dict)


class Agent(ABC):
    """A policy of the environment.

    Subclasses say which environment settings they need; evaluation makes the environment with them. An agent sees the
    observation and, at reset, the public part of `info`: nothing of the object's pose unless its `obs_mode` is `state`.
    """

    env_settings: ClassVar[Mapping[str, Any]] = {}
    """Keyword arguments of `gym.make` that this agent needs, e.g. obs_mode and control_mode."""

    @classmethod
    def files(cls, name: str) -> Iterable[Path]:
        """Return the files that the outcomes of an agent of this name rest on, besides the code."""
        return ()

    @cached_property
    def report(self) -> Report:
        """Report of the agent: `reset` fills it in or sets another; every trial begins with a fresh one."""
        return Report()

    def seed(self, seed: int) -> None:  # noqa: B027  (agents without randomness need not override it)
        """Seed the agent's own randomness; called before every episode's `reset`."""

    def check_info(self, info: Info) -> None:  # noqa: B027  (most agents play in any environment)
        """Refuse an environment that the agent was not made for; called before the first trial.

        Args:
            info: as for `reset`.

        Raises:
            InputError: saying what is wrong.
        """

    @abstractmethod
    def reset(self, observation: Observation, info: Info) -> None:
        """Start an episode: plan, or forget.

        Args:
            observation: the first observation.
            info: of the environment's reset, or its public part (`public_info`): its spaces, control_period (s),
                mount, cell, modes, when cameras look (observe), what perception says.
        """

    @abstractmethod
    def act(self, observation: Observation) -> Single:
        """Return the next action, within the environment's action space."""


def cell_of(info: Info, default: Cell) -> Cell:
    """Return the cell that an episode is in; where its info tells of none, the default's with the mount it tells of."""
    cell = info.get("cell")
    return cell if isinstance(cell, Cell) else default.mounted(info.get("mount"))


def public_info(env: Env, info: Info) -> Fields:
    """Return the part of a reset's info that an agent may know: nothing of the object but what perception says."""
    known: Fields = env.unwrapped.agent_info | {"action_space": env.action_space}  # type: ignore[attr-defined]
    return known | {key: value for key, value in info.items() if key.startswith("perception")}


def complete(name: str, agent: Any) -> Any:
    """Check a user's object for what every agent needs, and give it what it may leave out.

    Returned as it is where it has all, so that duck-typed agents need not import anything of ours.

    Args:
        name: that it was asked for by.
        agent: the object.

    Raises:
        InputError: if it is no agent.
    """
    for member in ("reset", "act"):
        if not callable(getattr(agent, member, None)):
            raise InputError(f"agent {name!r} has no method {member}(): valid agents have reset() and act()")
    for member, default in {"env_settings": {}, "seed": lambda seed: None, "report": Report()}.items():
        if not hasattr(agent, member):
            try:
                setattr(agent, member, default)
            except (AttributeError, TypeError):
                raise InputError(f"agent {name!r} has no {member}, and cannot be given one") from None
    check(f"env_settings of agent {name!r}", agent.env_settings, instance(Mapping, "a mapping"))
    return agent


def renew_report(agent: Agent) -> None:
    """Give an agent a fresh report before an episode, unless it is of the agent's own class or not to be set."""
    if type(agent.report) is Report:
        with suppress(AttributeError):
            agent.report = Report()


def report_of(agent: Agent) -> Report:
    """Return what an agent says, and what a report of a user's own class leaves out."""
    own, default = agent.report, Report()
    if isinstance(own, Report):
        return own
    return Report(**{name: getattr(own, name, value) for name, value in vars(default).items()})
