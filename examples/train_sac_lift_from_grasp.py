"""SAC of Stable-Baselines3 with demonstrations in its replay buffer, on `LiftFromGrasp`: palm and hand step by step.

`python examples/train_sac_lift_from_grasp.py --episodes 3000` generates demonstrations of `bilevel` in `out/lift_demos`
where there are none, and writes `out/sac_demos.zip` and its curve beside it.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import gymnasium as gym
import torch
from stable_baselines3 import SAC

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.learning.reinforcement.demo_replay import add_demonstrations

PARSER = argparse.ArgumentParser(description=__doc__)
PARSER.add_argument("--objects", nargs="+", default=["tomato_soup_can"], help="names, sets, mesh files")
PARSER.add_argument("--demos", type=Path, default=Path("out/lift_demos"), help="of `dexgrasp demos generate`")
PARSER.add_argument("--episodes", type=int, default=1000, help="80 actions each; a tenth of it demonstrated")
PARSER.add_argument("--every", type=int, default=100, help="episodes from one look to the next")
PARSER.add_argument("--trials", type=int, default=100, help="fresh scenes in the end")
PARSER.add_argument("--seed", type=int, default=0)
PARSER.add_argument("--out", type=Path, default=Path("out/sac_demos"))


def held(model: SAC, env: gym.Env, scenes: range) -> int:
    """Return in how many scenes, by seed, the policy's mean actions end with the object held."""
    count = 0
    for seed in scenes:
        (look, info), over = env.reset(seed=seed), False
        while not (over or info["is_success"]):
            look, _, terminated, truncated, info = env.step(model.predict(look, deterministic=True)[0])
            over = terminated or truncated
        count += info["is_success"]
    return count


def main() -> None:
    """Train, look at 20 starts now and then, from home in the end; the minutes are the learner's alone."""
    args, curve, minutes = PARSER.parse_args(), [], 0.0
    torch.set_num_threads(1)
    if not args.demos.exists():
        few = str(max(args.episodes // 10, 2))
        command = [sys.executable, "-m", "dexgrasp_env", "demos", "generate", "--objects", *args.objects]
        subprocess.run([*command, "--episodes", few, "--out", str(args.demos)], check=True)
    env, other = (gym.make("DexGrasp/LiftFromGrasp-v0", objects=args.objects) for _ in range(2))
    home = gym.make("DexGrasp/LiftFromGrasp-v0", objects=args.objects, starts=None, max_episode_steps=150)
    model = SAC("MlpPolicy", env, learning_starts=0, seed=args.seed, device="cpu")
    print(add_demonstrations(model, args.demos), "steps of demonstrations")
    actions = 80  # an episode
    while model.num_timesteps < actions * args.episodes:
        began = time.process_time()
        model.learn(actions * args.every, reset_num_timesteps=not curve)
        minutes += (time.process_time() - began) / 60
        look = {"episodes": model.num_timesteps // actions, "cpu_minutes": minutes}
        curve.append(look | {"held_of_20": held(model, other, range(min(20, args.trials)))})
        print(curve[-1], "level", env.unwrapped.observe()[1]["level"], flush=True)
    model.save(args.out)
    fresh = held(model, home, range(1000, 1000 + args.trials))
    print(fresh, "of", args.trials, "fresh scenes held from home")
    told = {"curve": curve, "fresh": fresh, "of": args.trials, "seed": args.seed, "objects": args.objects}
    args.out.with_name(f"{args.out.name}_curve.json").write_text(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
