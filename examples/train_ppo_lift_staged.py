"""PPO of Stable-Baselines3 on `LiftStaged`: six looks an episode, each a set-point in the grasp space.

`python examples/train_ppo_lift_staged.py` writes `out/ppo.zip`, an agent by its path (`dexgrasp evaluate --agents
ppo:out/ppo.zip --objects tomato_soup_can`), and `out/ppo_curve.json`. It takes 15 CPU minutes; seeds differ much.
"""

import argparse
import json
import time
from pathlib import Path

import gymnasium as gym
import torch
from stable_baselines3 import PPO

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.data.demonstrations.resets import DemoResets

PARSER = argparse.ArgumentParser(description=__doc__)
PARSER.add_argument("--objects", nargs="+", default=["tomato_soup_can"], help="names, sets, mesh files")
PARSER.add_argument("--episodes", type=int, default=1800, help="six actions each")
PARSER.add_argument("--every", type=int, default=250, help="episodes from one look to the next")
PARSER.add_argument("--trials", type=int, default=100, help="fresh scenes in the end")
PARSER.add_argument("--demos", type=Path, help="of `dexgrasp demos generate`: episodes begin along them")
PARSER.add_argument("--seed", type=int, default=0)
PARSER.add_argument("--out", type=Path, default=Path("out/ppo"))
LOOKS, BATCH = 6, 20  # actions an episode; episodes from one update to the next


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


def main() -> None:
    """Train, look at 20 scenes now and then, at fresh ones in the end; the minutes are the learner's alone."""
    args, curve, minutes = PARSER.parse_args(), [], 0.0
    torch.set_num_threads(1)
    env, other = (gym.make("DexGrasp/LiftStaged-v1", objects=args.objects) for _ in range(2))
    if args.demos:
        DemoResets(args.demos).attach(env)
    steps = LOOKS * min(args.every, BATCH)
    model = PPO(
        "MlpPolicy", env, n_steps=steps, batch_size=min(60, steps), learning_rate=0.001, gamma=0.95,
        policy_kwargs={"log_std_init": -0.5}, seed=args.seed, device="cpu",
    )  # fmt: skip
    args.out.parent.mkdir(parents=True, exist_ok=True)
    while model.num_timesteps < LOOKS * args.episodes:
        began = time.process_time()
        model.learn(LOOKS * args.every, reset_num_timesteps=not curve)
        minutes += (time.process_time() - began) / 60
        look = {"episodes": model.num_timesteps // LOOKS, "cpu_minutes": minutes}
        curve.append(look | {"held_of_20": held(model, other, range(20))})
        print(curve[-1], flush=True)
        if curve[-1]["held_of_20"] >= max(own["held_of_20"] for own in curve):
            model.save(args.out)  # the best look is kept: they swing
    fresh = held(PPO.load(args.out, device="cpu"), other, range(1000, 1000 + args.trials))
    print(fresh, "of", args.trials, "fresh scenes held")
    told = {"settings": vars(args), "curve": curve, "fresh": fresh}
    args.out.with_name(f"{args.out.name}_curve.json").write_text(json.dumps(told, indent=1, default=str))


if __name__ == "__main__":
    main()
