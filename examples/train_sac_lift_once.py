"""SAC of Stable-Baselines3, its defaults, on `LiftOnce`: an episode is one action, a whole grasp.

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


def held(model: SAC, env: gym.Env, scenes: range) -> int:
    """Return in how many scenes, by seed, the policy's mean action ends with the object held."""
    count = 0
    for seed in scenes:
        observation, _ = env.reset(seed=seed)
        *_, info = env.step(model.predict(observation, deterministic=True)[0])
        count += info["is_success"]
    return count


def main() -> None:
    """Train, look at 20 scenes now and then, and at fresh ones in the end; trials are not part of the minutes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env-id", default="DexGrasp/LiftOnce-v0")
    parser.add_argument("--objects", nargs="+", default=["tomato_soup_can"], help="names, sets, mesh files")
    parser.add_argument("--episodes", type=int, default=2000, help="one action each")
    parser.add_argument("--every", type=int, default=250, help="episodes from one look to the next")
    parser.add_argument("--trials", type=int, default=100, help="fresh scenes in the end")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/sac"))
    args = parser.parse_args()
    torch.set_num_threads(1)

    env, other = (gym.make(args.env_id, objects=args.objects) for _ in range(2))
    model = SAC("MlpPolicy", env, seed=args.seed, device="cpu")
    args.out.parent.mkdir(parents=True, exist_ok=True)
    curve, minutes = [], 0.0
    while model.num_timesteps < args.episodes:
        began = time.process_time()
        model.learn(min(args.every, args.episodes - model.num_timesteps), reset_num_timesteps=not curve)
        minutes += (time.process_time() - began) / 60
        curve.append(
            {
                "episodes": model.num_timesteps,
                "cpu_minutes": minutes,
                "held_of_20": held(model, other, range(20)),
            }
        )
        print(curve[-1], flush=True)
    model.save(args.out)
    fresh = held(model, other, range(1000, 1000 + args.trials))
    print(f"{fresh} of {args.trials} fresh scenes held")
    result = {"settings": vars(args) | {"out": str(args.out)}, "curve": curve, "fresh": [fresh, args.trials]}
    args.out.with_name(f"{args.out.name}_curve.json").write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
