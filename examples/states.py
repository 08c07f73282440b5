"""States: an episode that is saved and continued, bit for bit."""

import gymnasium as gym
import numpy as np

import dexgrasp_env  # noqa: F401  (registers the environments)

# Play ten steps twice from one state and compare.
env = gym.make("DexGrasp/Lift-v2", objects="soda")
env.reset(seed=0)
env.action_space.seed(0)
actions = [env.action_space.sample() for _ in range(10)]
state = env.unwrapped.get_state()
ends = []
for _ in range(2):
    env.unwrapped.set_state(state)
    for action in actions:
        observation, *_ = env.step(action)
    ends.append(observation["joint_positions"])
print("the same:", np.array_equal(*ends))
assert np.array_equal(*ends)
env.close()
