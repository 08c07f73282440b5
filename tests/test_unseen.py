"""The side that one camera does not see, completed."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from robots import CELL

from dexgrasp.geometry.completion import completed_corners
from dexgrasp.geometry.hull import cloud_corners
from dexgrasp.planning.plan_scene import plan_scene
from dexgrasp.planning.planner import Planner
from dexgrasp_env.arrays import fibonacci_directions
from dexgrasp_env.perception.scene import Scene

LEVEL = fibonacci_directions(200)
LEVEL = LEVEL[np.abs(LEVEL[:, 2]) < 0.5]


class Look:
    """What cameras see of an object, and its true hull."""

    def __init__(self, name, views, seed):
        env = gym.make("DexGrasp/Lift-v2", objects=name, obs_mode="pointcloud", observe="reset", views=views)
        observation, info = env.reset(seed=seed)
        self.scene = Scene.of_observation(observation, info)
        self.points, self.plane = self.scene.target.points, self.scene.plane
        simulation = env.unwrapped.simulation
        T = simulation.data.body("object")
        self.true = simulation.hull @ T.xmat.reshape(3, 3).T + T.xpos
        self.eyes = self.scene.cameras[:, :3, 3]
        env.close()

    @property
    def cloud(self):
        return self.scene.target, self.plane

    def off(self, corners, directions=LEVEL):
        """How far a hull reaches beyond the true one in directions, m."""
        return (corners @ directions.T).max(0) - (self.true @ directions.T).max(0)


@pytest.fixture(scope="module", params=["sugar_box", "soda", "ramen"])
def one_view(request):
    return Look(request.param, 1, seed=3)


def test_one_view_is_completed_to_the_true_size(one_view):
    corners, spread = completed_corners(*one_view.cloud)
    assert spread is not None
    assert np.abs(one_view.off(corners)).mean() < 0.004
    assert np.abs(one_view.off(corners)).max() < 0.015
    # Without completion the far side is missing by centimetres: the test can fail.
    assert np.abs(one_view.off(cloud_corners(one_view.points, one_view.plane))).max() > 0.025


def test_an_object_seen_all_round_is_left_as_it_is():
    look = Look("soda", 4, seed=3)
    corners, spread = completed_corners(*look.cloud)
    plain = cloud_corners(look.points, look.plane)
    assert spread is None
    np.testing.assert_array_equal(corners, plain)


def test_a_plan_says_whether_contacts_hold_the_nearest_guess_too(one_view):
    plan = plan_scene(Planner(cell=CELL), one_view.scene, 0, CELL.robot.home)
    target, contacts = plan.target, plan.grasp.contacts
    assert target.near is not None
    assert target.near.distance(one_view.points).max() < 0.004  # it holds all that was seen
    assert plan.hidden_side.startswith("doubt") == (target.gap(contacts) >= 0.003)
    plan.target = replace(target, near=target.distance)
    assert plan.hidden_side.startswith("contacts hold the nearest")
    plan.target = replace(target, near=None)
    assert plan.hidden_side == ""
