"""A named object as it lies in front of the cameras: what `dexgrasp plan`, `view` and `demo` begin with."""

from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from dexgrasp.agent import Agent, Observation, public_info
from dexgrasp.geometry.surface_samples import triangle_samples
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.planned_record import ObjectPose
from dexgrasp_env.arrays import Array, Fields, Mask
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import has_own_size
from dexgrasp_env.poses import placed, pose_matrix


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

    def marked(self, mask: Mask) -> Array:
        """Return points (N, 3) m, frame of the robot's base, of the faces of the mesh file that a mask marks.

        Raises:
            InputError: where the object is no mesh file, or has other faces.
        """
        from dexgrasp_env.objects.user_mesh import read_mesh

        lift: Any = self.env.unwrapped
        if has_own_size(lift.target):
            raise InputError("a mask of a region is of the points of a cloud, or of the faces of a mesh file")
        mesh = read_mesh(Path(lift.target))
        if mask.size != len(mesh.faces):
            raise InputError(
                f"the mask has {mask.size} values: valid is one for each of {len(mesh.faces)} faces"
            )
        faces = lift.settings.mesh_scale * np.asarray(mesh.triangles)[mask.ravel()]
        points = triangle_samples(faces, 3000, 0).points - lift.simulation.object.file_centre
        return placed(lift.settings.cell.T_base_world @ self.subject.pose.T_world_object, points)


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
