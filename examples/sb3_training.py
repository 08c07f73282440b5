"""Stable-Baselines3 on the native vector environment: a training of seconds, saved as a checkpoint.

`dexgrasp evaluate --agents ppo:out/ppo.zip --objects sugar_box --trials 10` scores it.
"""

from pathlib import Path

from stable_baselines3 import PPO

from dexgrasp.learning.reinforcement.sb3_vec_env import SB3VecEnv

# Train for 256 steps, which learn nothing; a million are a start.
envs = SB3VecEnv("DexGrasp/Lift-v2", num_envs=8, objects="sugar_box", obs_mode="state")
model = PPO("MultiInputPolicy", envs, n_steps=16, batch_size=128, n_epochs=1, seed=0, device="cpu")
model.learn(256)
Path("out").mkdir(exist_ok=True)
model.save("out/ppo")
print("trained for", model.num_timesteps, "steps")
