"""The grasp that an agent has planned, as a grasp file holds it."""

from typing import Any

import gymnasium as gym

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import pose_matrix


def object_pose(env: gym.Env[Any, Any]) -> Array:
    """Return the true pose (4, 4) of the object; for files and pictures, agents do not see it."""
    qpos = env.unwrapped.simulation.data.qpos  # type: ignore[attr-defined]
    return pose_matrix(qpos[23:26].copy(), qpos[26:30].copy())


def planned_grasp(env: gym.Env[Any, Any], agent: Any, T_world_object: Array) -> dict[str, Any] | None:
    """Return the certified grasp of an agent that has planned, None for agents that certify nothing."""
    plan, target = getattr(agent, "plan", None), getattr(agent, "grasp_target", None)
    grasp = getattr(plan, "grasp", None)
    if grasp is None or target is None or agent.report.failure:
        return None
    from agents.grasp.file import grasp_json
    from agents.planning.settings import PlannerSettings

    settings = getattr(agent, "settings", None) or PlannerSettings()
    name = env.unwrapped.simulation.object.name  # type: ignore[attr-defined]
    return grasp_json(name, grasp, target, settings, T_world_object)
