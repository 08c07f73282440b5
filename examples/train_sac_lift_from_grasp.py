"""SAC of Stable-Baselines3 with demonstrations in its replay buffer, on `LiftFromGrasp`: palm and hand step by step.

`python examples/train_sac_lift_from_grasp.py --episodes 3000` generates demonstrations of `bilevel` in `out/lift_demos`
where there are none, of a tenth as many scenes, and writes `out/sac_demos.zip` and its curve beside it; the fresh
scenes begin at home.
"""

import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import torch
from stable_baselines3 import SAC
from training.looks import options, train

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.learning.reinforcement.demo_replay import add_demonstrations

parser = options(__doc__, "out/sac_demos", episodes=1000, every=100)
parser.add_argument("--demos", type=Path, default=Path("out/lift_demos"), help="of `dexgrasp demos generate`")
args = parser.parse_args()
torch.set_num_threads(1)
if not args.demos.exists():
    few = str(max(args.episodes // 10, 2))
    command = [sys.executable, "-m", "dexgrasp_env", "demos", "generate", "--objects", *args.objects]
    subprocess.run([*command, "--episodes", few, "--out", str(args.demos)], check=True)
env, other = (gym.make("DexGrasp/LiftFromGrasp-v0", objects=args.objects) for _ in range(2))
home = gym.make("DexGrasp/LiftFromGrasp-v0", objects=args.objects, starts=None, max_episode_steps=150)
model = SAC("MlpPolicy", env, learning_starts=0, seed=args.seed, device="cpu")
print(add_demonstrations(model, args.demos), "steps of demonstrations")
train(model, args, 80, other, home, beside=lambda: {"level": env.unwrapped.observe()[1]["level"]})
