"""A rehearsal of plans and environments: it calls each compiled function once."""

from dataclasses import replace

import gymnasium as gym
import numpy as np

from dexgrasp.geometry.completion import target_of
from dexgrasp.planning.cvae_source import make_source
from dexgrasp.planning.planner import Planner, small_box
from dexgrasp.planning.proposals import SurfaceProposals
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.perception.cloud import downsample
from dexgrasp_env.perception.scene import Scene


def rehearse() -> None:
    """Plan for a small box, look at an object, step; what takes longest to compile comes first."""
    planner = Planner(source=make_source("auto"))
    box, home = small_box(), planner.cell.robot.home.copy()
    planner.plan(box, 0, home)
    planner.plan(replace(box, neighbours=((np.add(box.corners, [0.0, 0.2, 0.0]),),)), 0, home)
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", obs_mode="pointcloud", views=1, observe="reset")
    observation, _ = env.reset(seed=0)
    target_of(Scene.of_observation(observation))
    downsample(np.zeros((9, 3)), 8, np.random.default_rng(0))
    env.step(env.action_space.sample())
    env.close()
    few = PlannerSettings(surface_points=40, triples=10)
    SurfaceProposals().propose(small_box(), few, np.random.default_rng(0))
