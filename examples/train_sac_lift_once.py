"""SAC of Stable-Baselines3 on `LiftOnce`: an episode is one action, a whole grasp.

`python examples/train_sac_lift_once.py --objects all20 --episodes 6000` writes `out/sac.zip`, an agent by its path
(`dexgrasp evaluate --agents sac:out/sac.zip --objects all20`), and `out/sac_curve.json`.
"""

import argparse
import json
import time
from pathlib import Path

import gymnasium as gym
import torch
from stable_baselines3 import SAC

import dexgrasp_env  # noqa: F401  (registers the environments)

PARSER = argparse.ArgumentParser(description=__doc__)
PARSER.add_argument("--objects", nargs="+", default=["tomato_soup_can"], help="names, sets, mesh files")
PARSER.add_argument("--episodes", type=int, default=1250, help="one action each")
PARSER.add_argument("--every", type=int, default=250, help="episodes from one look to the next")
PARSER.add_argument("--trials", type=int, default=100, help="fresh scenes in the end")
PARSER.add_argument("--seed", type=int, default=0)
PARSER.add_argument("--out", type=Path, default=Path("out/sac"))


def held(model: SAC, env: gym.Env, scenes: range) -> int:
    """Return in how many scenes, by seed, the policy's mean action ends with the object held."""
    looks = (env.reset(seed=seed)[0] for seed in scenes)
    return sum(env.step(model.predict(look, deterministic=True)[0])[4]["is_success"] for look in looks)


def main() -> None:
    """Train, look at 20 scenes now and then, at fresh ones in the end; the minutes are the learner's alone."""
    args, curve, minutes = PARSER.parse_args(), [], 0.0
    torch.set_num_threads(1)
    env, other = (gym.make("DexGrasp/LiftOnce-v0", objects=args.objects) for _ in range(2))
    model = SAC("MlpPolicy", env, seed=args.seed, device="cpu")
    args.out.parent.mkdir(parents=True, exist_ok=True)
    while model.num_timesteps < args.episodes:
        began = time.process_time()
        model.learn(min(args.every, args.episodes - model.num_timesteps), reset_num_timesteps=not curve)
        minutes += (time.process_time() - began) / 60
        look = {"episodes": model.num_timesteps, "cpu_minutes": minutes}
        look["held_of_20"] = held(model, other, range(20))
        curve.append(look)
        print(look, flush=True)
    model.save(args.out)
    fresh = held(model, other, range(1000, 1000 + args.trials))
    settings = vars(args) | {"out": str(args.out)}
    told = {"settings": settings, "curve": curve, "fresh": fresh, "of": args.trials}
    print(fresh, "of", args.trials, "fresh scenes held")
    args.out.with_name(f"{args.out.name}_curve.json").write_text(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
