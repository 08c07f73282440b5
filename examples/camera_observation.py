"""Cameras: depth images and the segmented cloud that four simulated depth cameras see. No GL is needed."""

import gymnasium as gym

import dexgrasp_env  # noqa: F401  (registers the environments)

# Print what is seen of a bottle, once as a cloud and once as depth images.
env = gym.make("DexGrasp/Lift-v2", objects="mustard_bottle", obs_mode="pointcloud", observe="reset")
observation, info = env.reset(seed=0)
points = observation["cloud"][observation["cloud_mask"].astype(bool)]
print(len(points), "points from", points.min(axis=0), "to", points.max(axis=0), info["perception_failure"])
env.close()

env = gym.make("DexGrasp/Lift-v2", objects="mustard_bottle", obs_mode="depth", observe="reset")
observation, info = env.reset(seed=0)
depth = observation["depth"]
print("images:", depth.shape, "nearest, m:", depth[depth > 0].min())
print("poses of the cameras:", info["perception_T_world_camera"].shape)
env.close()
