"""Demonstrations of an agent: generated as a Minari data set, and used to begin episodes near success."""

import subprocess
import sys

import gymnasium as gym

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.data.demonstrations import DemoResets

# Record two episodes of `hardcoded` and begin four environments along them.
command = [sys.executable, "-m", "dexgrasp_env", "demos", "generate", "--agent", "hardcoded"]
subprocess.run([*command, "--objects", "sugar_box", "--episodes", "2", "--out", "out/demos"], check=True)

envs = gym.make_vec("DexGrasp/Lift-v2", num_envs=4, objects="sugar_box")
resets = DemoResets("out/demos").attach(envs)
envs.reset(seed=0)
print("episodes begin from this share of a demonstration on:", resets.front)
envs.close()
