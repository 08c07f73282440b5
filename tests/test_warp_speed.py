"""Random actions on the device: nothing goes wrong, and how fast it is; of DEXGRASP_WARP_SIZE; -s shows it."""

import os
import time

import gymnasium as gym
import numpy as np
import pytest
from warp_envs import ID, WARP, N

from dexgrasp_env.objects.load import resolve_targets

pytestmark = pytest.mark.warp

SIZE = int(os.environ.get("DEXGRASP_WARP_SIZE", N))
STEPS = 10 if SIZE == N else 40
OBJECTS = [name for name in resolve_targets(["all20"]) if name != "massage_ball"]  # of 33 parts


def test_random_actions_go_right_and_this_fast():
    rng = np.random.default_rng(2)
    envs = gym.make_vec(ID, num_envs=SIZE, objects=OBJECTS, **WARP)
    envs.reset(seed=2)
    envs.unwrapped._episodes.records["elapsed"] = rng.integers(0, 300, SIZE)  # they end at different times
    for step in range(STEPS + 1):
        actions = rng.uniform(-1, 1, envs.action_space.shape)
        observation, rewards, *_, infos = envs.step(actions)
        if step == 0:  # the kernels were compiled
            start = time.perf_counter()
        right = infos["failure"] != "simulation_diverged"
        assert all(np.isfinite(values[right]).all() for values in (rewards, *observation.values()))
    print(f"{SIZE} environments: {SIZE * STEPS / (time.perf_counter() - start):,.0f} steps a second")
    envs.close()
