"""Planning agents and observations that no camera and no robot gives: a plan or the reason for none, no exception."""

import numpy as np
import pytest
from refusals import refused
from robots import HOME

from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.agents.hardcoded import HardcodedAgent
from dexgrasp.learning.imitation.cloud_features import observed_cloud

RNG = np.random.default_rng(0)
BLOB = RNG.uniform([0.45, -0.03, 0.02], [0.51, 0.03, 0.08], (256, 3))
CLOUDS = {
    "not a number": np.full((256, 3), np.nan),
    "in an upright plane": BLOB * np.array([1, 0, 1]),
    "on a line": np.linspace([0.4, 0, 0.05], [0.6, 0, 0.05], 256),
    "one point": np.tile([0.5, 0.0, 0.05], (256, 1)),
    "below the table": BLOB - [0, 0, 0.3],
}


@pytest.fixture(scope="module", params=["surface", "cvae", "hardcoded"])
def agent(request):
    return HardcodedAgent() if request.param == "hardcoded" else BilevelAgent(request.param)


def observation(cloud, targets=HOME):
    plane = np.array([0.0, 0.0, 1.0, 0.0, 0.001])
    seen = {"cloud": cloud, "cloud_normals": cloud, "cloud_mask": np.ones(256)}
    return seen | {"joint_targets": targets, "table_plane": plane}


@pytest.mark.parametrize("name", CLOUDS)
def test_strange_clouds_raise_nothing(agent, name):
    agent.seed(0)
    agent.reset(observation(CLOUDS[name]), {})
    if name in ("not a number", "one point"):
        assert agent.report.failure


@pytest.mark.parametrize("targets", [np.full(23, 1e3), np.full(23, np.nan), HOME[:7]])
def test_starts_that_the_robot_cannot_have_are_refused(agent, targets):
    with refused("joint_targets"):
        agent.reset(observation(BLOB, targets), {})


@pytest.mark.parametrize("key", ["cloud", "cloud_mask", "cloud_normals"])
def test_a_clone_that_looks_at_clouds_says_what_it_lacks(key):
    seen = observation(BLOB)
    del seen[key]
    with refused("pointcloud"):
        observed_cloud(seen)
