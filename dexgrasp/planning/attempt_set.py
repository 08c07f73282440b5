"""Planning many grasps of a named object as it lies in front of the cameras: what `dexgrasp plan --count` does."""

from dataclasses import dataclass
from typing import Any

from dexgrasp.planning.attempt import Attempt, planning_agent, seen
from dexgrasp.planning.many import GraspSet, Progress
from dexgrasp.planning.planned import content_of
from dexgrasp_env.errors import InputError


@dataclass
class SetAttempt:
    """One look at an object, and the grasps that were planned from it.

    Attributes:
        attempt: the look; its agent carries nothing out.
        found: the grasps; empty where no object was seen.
        asked: how many were asked for.
    """

    attempt: Attempt
    found: GraspSet
    asked: int

    def contents(self) -> list[dict[str, Any] | None]:
        """Return the grasps as grasp files hold them, firmest first."""
        at, plans = self.attempt, self.found.plans
        seconds = (at.agent.report.planning_seconds or 0.0) / max(len(plans), 1)
        return [content_of(plan, at.env, at.agent, at.T_world_object, at.seed, seconds) for plan in plans]

    def as_json(self) -> dict[str, Any]:
        """Return the object that `dexgrasp plan --count K --json` prints; `grasp` is the firmest."""
        contents, search = self.contents(), self.found.search
        first = contents[0] if contents else None
        return self.attempt.as_json() | {
            "success": len(contents) == self.asked,
            "reason": self.attempt.agent.report.failure or search.reason,
            "violations": {reason: float(least) for reason, (_, least) in search.blocked.items()},
            "grasp": first,
            "certificate": None if first is None else first["certificate"],
            **self.found.as_json(contents, self.asked),
        }


def plan_target_set(
    target: str,
    count: int,
    agent_name: str = "bilevel",
    seed: int = 0,
    progress: Progress | None = None,
    **env_settings: Any,
) -> SetAttempt:
    """Put an object on the table, look at it, and plan grasps that differ.

    Args:
        target: name of the catalogue or path of a mesh.
        count: grasps asked for.
        agent_name: `bilevel`, or another agent with `plan_set`.
        seed: of scene and planner.
        progress: called with steps done and steps in all.
        **env_settings: more arguments of `gym.make`.

    Raises:
        InputError: for an unknown target or agent, a count out of range, or an agent that plans no sets.
    """
    agent = planning_agent(agent_name, env_settings.get("friction"))
    plan_set = getattr(agent, "plan_set", None)
    if plan_set is None:
        raise InputError(f"agent {agent_name!r} plans no sets of grasps: valid is bilevel")
    attempt, info = seen(target, agent, seed, env_settings)
    return SetAttempt(attempt, plan_set(attempt.observation, info, count, progress) or GraspSet(), count)
