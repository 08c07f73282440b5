"""PPO of Stable-Baselines3 on `LiftVaried`: an episode is one action, a whole grasp at a place that has to be seen.

`python examples/train_ppo_lift_varied.py` learns on forty drawn shapes and is looked at on forty others; it writes
`out/varied.zip`, an agent by its path (`dexgrasp evaluate --agents ppo:out/varied.zip --protocol varied --objects
drawn-0..39`), and `out/varied_curve.json`. The noise of actions narrows by a schedule.
"""

import argparse
import json
import time
from pathlib import Path

import gymnasium as gym
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

import dexgrasp_env  # noqa: F401  (registers the environments)

PARSER = argparse.ArgumentParser(description=__doc__)
PARSER.add_argument("--objects", nargs="+", default=["drawn-1000..1039"], help="names, sets, mesh files")
PARSER.add_argument("--test", nargs="+", default=["drawn-0..39"], help="objects to look at")
PARSER.add_argument("--episodes", type=int, default=10000, help="one action each")
PARSER.add_argument("--every", type=int, default=1000, help="episodes from one look to the next")
PARSER.add_argument("--trials", type=int, default=200, help="fresh scenes in the end")
PARSER.add_argument("--seed", type=int, default=0)
PARSER.add_argument("--out", type=Path, default=Path("out/varied"))


class Narrowing(BaseCallback):
    """Schedule of the logarithm of the actions' standard deviation, -0.7 to -2 over all episodes."""

    def __init__(self, episodes: int) -> None:
        super().__init__()
        self.episodes = episodes

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self.model.policy.log_std.data.fill_(-0.7 - 1.3 * min(self.num_timesteps / self.episodes, 1.0))


def held(model: PPO, env: gym.Env, scenes: range) -> int:
    """Return in how many scenes, by seed, the policy's mean action ends with the object held."""
    looks = (env.reset(seed=seed)[0] for seed in scenes)
    return sum(env.step(model.predict(look, deterministic=True)[0])[4]["is_success"] for look in looks)


def main() -> None:
    """Train, look at 20 scenes now and then, at fresh ones in the end; the minutes are the learner's alone."""
    args, curve, minutes = PARSER.parse_args(), [], 0.0
    torch.set_num_threads(1)
    env, other = (gym.make("DexGrasp/LiftVaried-v1", objects=names) for names in (args.objects, args.test))
    steps = min(250, args.every)
    model = PPO(
        "MlpPolicy", env, n_steps=steps, batch_size=min(50, steps), learning_rate=5e-4, target_kl=0.05,
        policy_kwargs={"log_std_init": -0.7}, seed=args.seed, device="cpu",
    )  # fmt: skip
    args.out.parent.mkdir(parents=True, exist_ok=True)
    while model.num_timesteps < args.episodes:
        began = time.process_time()
        model.learn(args.every, reset_num_timesteps=not curve, callback=Narrowing(args.episodes))
        minutes += (time.process_time() - began) / 60
        look = {"episodes": model.num_timesteps, "cpu_minutes": minutes}
        curve.append(look | {"held_of_20": held(model, other, range(20))})
        print(curve[-1], flush=True)
        model.save(args.out)
    fresh = held(model, other, range(1000, 1000 + args.trials))
    print(fresh, "of", args.trials, "fresh scenes held")
    told = {"settings": vars(args), "curve": curve, "fresh": fresh}
    args.out.with_name(f"{args.out.name}_curve.json").write_text(json.dumps(told, indent=1, default=str))


if __name__ == "__main__":
    main()
