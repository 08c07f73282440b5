"""Sixteen environments as one: native, on all cores, bit for bit as sixteen single ones."""

import gymnasium as gym

import dexgrasp_env  # noqa: F401  (registers the environments)

# Step random actions and print the mean reward.
envs = gym.make_vec("DexGrasp/Lift-v2", num_envs=16, objects="seen")
observation, _ = envs.reset(seed=0)
print({key: value.shape for key, value in observation.items()})
envs.action_space.seed(0)
total = 0.0
for _ in range(20):
    _, reward, _, _, _ = envs.step(envs.action_space.sample())
    total += reward.mean()
print("mean reward of 20 steps:", total / 20)
envs.close()
