"""SAC of Stable-Baselines3 on `LiftOnce` or `LiftVaried`: an episode is one action, a whole grasp.

`python examples/train_sac_lift_once.py --objects all20 --episodes 6000` writes `out/sac.zip`, an agent by its path
(`dexgrasp evaluate --agents sac:out/sac.zip --objects all20`), and `out/sac_curve.json`. On drawn shapes:
`--env-id DexGrasp/LiftVaried-v1 --objects drawn-1000..1039 --test drawn-0..39 --updates 4 --ent-coef auto_0.1`.
"""

import gymnasium as gym
import torch
from stable_baselines3 import SAC
from training.looks import options, train

import dexgrasp_env  # noqa: F401  (registers the environments)

parser = options(__doc__, "out/sac", episodes=1250, every=250)
parser.add_argument("--env-id", default="DexGrasp/LiftOnce-v0")
parser.add_argument("--test", nargs="+", help="objects to look at (default: those of training)")
parser.add_argument("--updates", type=int, default=1, help="gradient steps an episode")
parser.add_argument("--ent-coef", default="auto", help="entropy coefficient, as SAC takes it")
args = parser.parse_args()
torch.set_num_threads(1)
env, other = (gym.make(args.env_id, objects=names) for names in (args.objects, args.test or args.objects))
more = {"gradient_steps": args.updates, "ent_coef": args.ent_coef}
train(SAC("MlpPolicy", env, seed=args.seed, device="cpu", **more), args, 1, other, other)
