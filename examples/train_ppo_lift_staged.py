"""PPO of Stable-Baselines3 on `LiftStaged`: six looks an episode, each a set-point in the grasp space.

`python examples/train_ppo_lift_staged.py` writes `out/ppo.zip`, an agent by its path (`dexgrasp evaluate --agents
ppo:out/ppo.zip --objects tomato_soup_can`), and `out/ppo_curve.json`. It takes 15 CPU minutes; seeds differ much, and
looks swing: the best is kept.
"""

from pathlib import Path

import gymnasium as gym
import torch
from stable_baselines3 import PPO
from training.looks import options, train

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.data.demonstrations.resets import DemoResets

LOOKS, BATCH = 6, 20  # actions an episode; episodes from one update to the next

parser = options(__doc__, "out/ppo", episodes=1800, every=250)
parser.add_argument("--demos", type=Path, help="of `dexgrasp demos generate`: episodes begin along them")
args = parser.parse_args()
torch.set_num_threads(1)
env, other = (gym.make("DexGrasp/LiftStaged-v1", objects=args.objects) for _ in range(2))
if args.demos:
    DemoResets(args.demos).attach(env)
steps = LOOKS * min(args.every, BATCH)
model = PPO(
    "MlpPolicy", env, n_steps=steps, batch_size=min(60, steps), learning_rate=0.001, gamma=0.95,
    policy_kwargs={"log_std_init": -0.5}, seed=args.seed, device="cpu",
)  # fmt: skip
train(model, args, LOOKS, other, other, best=True)
