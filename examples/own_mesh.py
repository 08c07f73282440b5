"""A mesh of your own: written, loaded with its unit and mass, put into an environment."""

from pathlib import Path

import gymnasium as gym
import trimesh

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp_env.objects.load import load_object

# Load an angle drawn in millimetres and let it fall onto the table.
foot = trimesh.creation.box((60, 50, 20))
back = trimesh.creation.box((25, 50, 20), trimesh.transformations.translation_matrix((-17.5, 0, 20)))
Path("out").mkdir(exist_ok=True)
trimesh.util.concatenate([foot, back]).export("out/angle.stl")

angle = load_object("out/angle.stl", scale=0.001, mass=0.15)
print("sides, m:", angle.mesh.extents, "convex parts:", len(angle.parts), "mass, kg:", angle.mass)

env = gym.make("DexGrasp/Lift-v2", objects="out/angle.stl", mesh_scale=0.001, mesh_mass=0.15)
observation, _ = env.reset(seed=3)
print("lies at:", observation["object_pose"][:3])
env.close()
