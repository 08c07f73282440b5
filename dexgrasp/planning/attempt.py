"""Planning for a named object as it lies in front of the cameras: what `dexgrasp plan` and `dexgrasp demo` do."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
from numpy.typing import NDArray

import dexgrasp_env  # noqa: F401  (registers the environment)
from dexgrasp.agent import Agent
from dexgrasp.evaluation.trial import public_info
from dexgrasp.grasp.grasp import Grasp
from dexgrasp.planning.planned import object_pose, planned_grasp
from dexgrasp.registry import make_agent
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError


@dataclass
class Attempt:
    """One planning attempt, with the environment it was made in.

    Attributes:
        name: of the object.
        env: reset, not yet stepped.
        agent: has planned.
        observation: the first one.
        T_world_object: (4, 4) true pose; for files and pictures, the agent has not seen it.
        seed: of scene and agent.
    """

    name: str
    env: gym.Env[Any, Any]
    agent: Agent
    observation: dict[str, NDArray[Any]]
    T_world_object: Array
    seed: int

    @property
    def grasp(self) -> Grasp | None:
        """The certified grasp, or None."""
        plan = getattr(self.agent, "plan", None)
        return None if plan is None else plan.grasp

    @property
    def grasp_target(self) -> GraspTarget | None:
        """What the agent took the object for."""
        return getattr(self.agent, "grasp_target", None)

    def as_json(self) -> dict[str, Any]:
        """Return the object that `dexgrasp plan --json` prints."""
        report = self.agent.report
        reason = report.failure
        content = planned_grasp(self.env, self.agent, self.T_world_object, self.seed)
        return {
            "schema": 1,
            "object": self.name,
            "success": content is not None,
            "reason": reason,
            "planning_seconds": report.planning_seconds,
            "stages": report.details.get("stages", {}),
            "blocked": report.details.get("blocked", {}),
            "violations": _violations(self.agent),
            "grasp": content,
            "certificate": None if content is None else content["certificate"],
        }


def _violations(agent: Agent) -> dict[str, float]:
    """Return by how much at least each reason blocked, where the agent has planned."""
    blocked = getattr(getattr(agent, "plan", None), "blocked", {})
    return {reason: float(least) for reason, (_, least) in blocked.items()}


def plan_target(target: str, agent_name: str = "bilevel", seed: int = 0, **env_settings: Any) -> Attempt:
    """Like `attempt_target`, for agents that make certified plans.

    Raises:
        InputError: for an unknown target or agent, or an agent that makes no certified plans.
    """
    agent = planning_agent(agent_name, env_settings.get("friction"))
    if not hasattr(agent, "plan"):
        raise InputError(
            f"agent {agent_name!r} makes no certified plans: valid are bilevel, cvae, cvae_kinematics"
        )
    return _attempt(target, agent, seed, env_settings)


def attempt_target(target: str, agent_name: str = "bilevel", seed: int = 0, **env_settings: Any) -> Attempt:
    """Put an object on the table, look at it, and let an agent plan.

    A planner is told the friction that is asked for, and counts on its usual share of that.

    Args:
        target: name of the catalogue or path of a mesh.
        agent_name: see `registry`.
        seed: of the scene and of the agent.
        **env_settings: more arguments of `gym.make`, e.g. mesh_scale, mount, render_mode.

    Raises:
        InputError: for an unknown target or agent.
    """
    return _attempt(target, planning_agent(agent_name, env_settings.get("friction")), seed, env_settings)


def planning_agent(name: str, friction: float | None) -> Agent:
    """Make an agent; a planner of ours for surfaces of that friction, where it is given."""
    from dexgrasp.planning.settings import PlannerSettings

    agent = make_agent(name)
    if friction is None or not isinstance(getattr(agent, "settings", None), PlannerSettings):
        return agent
    return make_agent(name, settings=PlannerSettings.for_friction(friction))


def _attempt(target: str, agent: Agent, seed: int, env_settings: Mapping[str, Any]) -> Attempt:
    attempt, info = seen(target, agent, seed, env_settings)
    agent.reset(attempt.observation, info)
    return attempt


def seen(
    target: str, agent: Agent, seed: int, env_settings: Mapping[str, Any]
) -> tuple[Attempt, dict[str, Any]]:
    """Put an object on the table and look at it; return what an agent's `reset` takes, the agent seeded."""
    env = gym.make("DexGrasp/Lift-v1", objects=target, **(dict(agent.env_settings) | dict(env_settings)))
    observation, info = env.reset(seed=seed)
    pose = object_pose(env)
    agent.seed(seed)
    name = env.unwrapped.simulation.object.name  # type: ignore[attr-defined]
    return Attempt(name, env, agent, observation, pose, seed), public_info(env, info)
