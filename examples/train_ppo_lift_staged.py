"""PPO of Stable-Baselines3 on `LiftStaged`: six looks an episode, each a set-point in the grasp space.

`python examples/train_ppo_lift_staged.py` generates demonstrations of `hardcoded` in `out/staged_demos` where there are
none, along which episodes begin (a reverse curriculum), and writes `out/ppo.zip`, an agent by its path (`dexgrasp
evaluate --agents ppo:out/ppo.zip --objects tomato_soup_can`), and `out/ppo_curve.json`. It takes 20 CPU minutes.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import gymnasium as gym
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.data.demonstrations.resets import DemoResets
from dexgrasp.learning.reinforcement.env_record import save_checkpoint

PARSER = argparse.ArgumentParser(description=__doc__)
PARSER.add_argument("--objects", nargs="+", default=["tomato_soup_can"], help="names, sets, mesh files")
PARSER.add_argument("--episodes", type=int, default=8000, help="six actions each")
PARSER.add_argument("--every", type=int, default=500, help="episodes from one look to the next")
PARSER.add_argument("--trials", type=int, default=100, help="fresh scenes in the end")
PARSER.add_argument(
    "--demos", type=Path, default=Path("out/staged_demos"), help="of `dexgrasp demos generate`"
)
PARSER.add_argument("--seed", type=int, default=0)
PARSER.add_argument("--out", type=Path, default=Path("out/ppo"))
LOOKS, BATCH = 6, 40  # actions an episode; episodes from one update to the next


def held(model: PPO, env: gym.Env, scenes: range) -> int:
    """Return in how many scenes, by seed, the policy's mean actions end with the object held."""
    count = 0
    for seed in scenes:
        (look, info), over = env.reset(seed=seed), False
        while not (over or info["is_success"]):
            look, _, terminated, truncated, info = env.step(model.predict(look, deterministic=True)[0])
            over = terminated or truncated
        count += info["is_success"]
    return count


class Looks(BaseCallback):
    """Looks at 20 scenes now and then, and noise of actions, whose logarithm goes from -1 to -2.2."""

    def __init__(self, other: gym.Env, every: int) -> None:
        super().__init__()
        self.other, self.every = other, LOOKS * every
        self.curve, self.began = list[dict](), time.process_time()

    def _on_rollout_start(self) -> None:
        self.model.policy.log_std.data.fill_(-1.0 - 1.2 * self.num_timesteps / self.locals["total_timesteps"])

    def _on_step(self) -> bool:
        if self.num_timesteps % self.every == 0:
            now = time.process_time()
            look = {"episodes": self.num_timesteps // LOOKS, "cpu_minutes": (now - self.began) / 60}
            self.curve.append(look | {"held_of_20": held(self.model, self.other, range(20))})
            print(self.curve[-1], flush=True)
            self.began += time.process_time() - now  # looks are no learning
        return True


def main() -> None:
    """Train, and look at fresh scenes in the end; the minutes are the learner's alone."""
    args = PARSER.parse_args()
    torch.set_num_threads(1)
    if not args.demos.exists():
        generate = f"demos generate --agent hardcoded --episodes {min(args.episodes, 20)} --objects".split()
        command = [sys.executable, "-m", "dexgrasp_env", *generate, *args.objects, "--out", str(args.demos)]
        subprocess.run(command, check=True)
    env, test = (gym.make("DexGrasp/LiftStaged-v1", objects=args.objects) for _ in range(2))
    DemoResets(args.demos).attach(env)
    steps, rate = LOOKS * min(args.episodes, BATCH), lambda left: 1e-3 * left + 5e-5
    more = {"gamma": 0.9, "target_kl": 0.1, "seed": args.seed, "device": "cpu"}
    model = PPO("MlpPolicy", env, rate, steps, min(60, steps), **more)
    model.learn(LOOKS * args.episodes, looks := Looks(test, args.every))
    save_checkpoint(model, f"{args.out}.zip")
    print(fresh := held(model, test, range(1000, 1000 + args.trials)), "of", args.trials, "fresh held")
    told = {"settings": vars(args), "curve": looks.curve, "fresh": fresh}
    args.out.with_name(f"{args.out.name}_curve.json").write_text(json.dumps(told, indent=1, default=str))


if __name__ == "__main__":
    main()
