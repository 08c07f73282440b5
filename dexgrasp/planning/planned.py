"""The grasp that an agent has planned, as a grasp file holds it."""

from typing import TYPE_CHECKING, Any

import gymnasium as gym

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import pose_matrix

if TYPE_CHECKING:
    from dexgrasp.grasp.identity import ObjectIdentity
    from dexgrasp.planning.plan import Plan


def object_pose(env: gym.Env[Any, Any]) -> Array:
    """Return the true pose (4, 4) of the object; for files and pictures, agents do not see it."""
    qpos = env.unwrapped.simulation.data.qpos  # type: ignore[attr-defined]
    return pose_matrix(qpos[23:26].copy(), qpos[26:30].copy())


def planned_grasp(
    env: gym.Env[Any, Any], agent: Any, T_world_object: Array, seed: int = 0
) -> dict[str, Any] | None:
    """Return the certified grasp of an agent that has planned, None for agents that certify nothing.

    Args:
        env: that was looked at.
        agent: that has planned.
        T_world_object: (4, 4) true pose.
        seed: it planned with.
    """
    plan, target = getattr(agent, "plan", None), getattr(agent, "grasp_target", None)
    if plan is None or target is None or agent.report.failure:
        return None
    return content_of(plan, env, agent, T_world_object, seed, agent.report.planning_seconds)


def content_of(
    plan: "Plan", env: gym.Env[Any, Any], agent: Any, T_world_object: Array, seed: int, seconds: float | None
) -> dict[str, Any] | None:
    """Return a plan of an agent as a grasp file holds it, None for one without a grasp; it took `seconds`."""
    if plan.grasp is None:
        return None
    from dexgrasp.grasp.file import ObjectPose, grasp_json
    from dexgrasp.planning.settings import PlannerSettings

    model = env.unwrapped.simulation.object  # type: ignore[attr-defined]
    return grasp_json(
        object_identity(env), plan.grasp, agent.grasp_target, getattr(agent, "settings", None) or PlannerSettings(),
        script=plan.script, pose=ObjectPose(model.solid, T_world_object), agent=_name_of(agent), seed=seed,
        planning_seconds=seconds,
    )  # fmt: skip


def object_identity(env: gym.Env[Any, Any]) -> "ObjectIdentity":
    """Return what the object of an environment can be found again by."""
    from dexgrasp.grasp.identity import ObjectIdentity
    from dexgrasp_env.objects.load import has_own_size

    lift = env.unwrapped
    model, settings, source = lift.simulation.object, lift.settings, lift.target  # type: ignore[attr-defined]
    return ObjectIdentity.of(model, source, 1.0 if has_own_size(source) else settings.mesh_scale)


def _name_of(agent: Any) -> str:
    from dexgrasp.registry import AGENTS

    spec = f"{type(agent).__module__}:{type(agent).__name__}"
    return next((name for name, known in AGENTS.items() if known == spec), spec)
