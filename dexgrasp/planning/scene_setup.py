"""A named object as it lies in front of the cameras: what `dexgrasp plan`, `view` and `demo` begin with."""

from typing import Any, NamedTuple

import gymnasium as gym

import dexgrasp_env  # noqa: F401  (registers the environment)
from dexgrasp.agent import Agent, Observation, public_info
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.planned_record import ObjectPose
from dexgrasp_env.arrays import Fields
from dexgrasp_env.poses import pose_matrix


class Subject(NamedTuple):
    """The object as files and pictures state it; agents are told none of it."""

    identity: ObjectIdentity
    pose: ObjectPose


class Look(NamedTuple):
    """Arguments of an agent's `reset`, and their source: an environment that was reset, not yet stepped."""

    env: gym.Env[Any, Any]
    observation: Observation
    info: Fields
    subject: Subject


def look_at(target: str, agent: Agent, seed: int = 0, **env_settings: Any) -> Look:
    """Put an object on the table and look at it as an agent does, which is seeded.

    Args:
        target: name of the catalogue or path of a mesh.
        agent: whose settings the environment is made with.
        seed: of the scene and of the agent.
        **env_settings: more arguments of `gym.make`, e.g. mesh_scale, mount, render_mode.

    Raises:
        InputError: for an unknown target or setting.
    """
    env = gym.make("DexGrasp/Lift-v2", objects=target, **(dict(agent.env_settings) | env_settings))
    observation, info = env.reset(seed=seed)
    agent.seed(seed)
    return Look(env, observation, public_info(env, info), subject_of(env))


def subject_of(env: gym.Env[Any, Any]) -> Subject:
    """Return the object of an environment, where it is now."""
    lift: Any = env.unwrapped
    model, pose = lift.simulation.object, lift.simulation.object_pose()
    identity = ObjectIdentity.of(model, lift.target, lift.settings.mesh_scale)
    return Subject(identity, ObjectPose(model.solid, pose_matrix(pose[:3], pose[3:])))
