"""What the training examples share: options, looks at fixed scenes while it learns, and the curve beside the policy."""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym


def options(page: str | None, out: str, *, episodes: int, every: int) -> argparse.ArgumentParser:
    """Return the parser of a training's options; its page is the help."""
    parser = argparse.ArgumentParser(description=page)
    parser.add_argument("--objects", nargs="+", default=["tomato_soup_can"], help="names, sets, mesh files")
    parser.add_argument("--episodes", type=int, default=episodes)
    parser.add_argument("--every", type=int, default=every, help="episodes from one look to the next")
    parser.add_argument("--trials", type=int, default=100, help="fresh scenes in the end")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path(out))
    return parser


def held(model: Any, env: gym.Env, scenes: range) -> int:
    """Return in how many scenes, by seed, the policy's mean actions end with the object held."""
    count = 0
    for seed in scenes:
        (look, info), over = env.reset(seed=seed), False
        while not (over or info["is_success"]):
            look, _, terminated, truncated, info = env.step(model.predict(look, deterministic=True)[0])
            over = terminated or truncated
        count += info["is_success"]
    return count


def train(
    model: Any, args: argparse.Namespace, actions: int, env: gym.Env, test: gym.Env, *, best: bool = False,
    beside: Callable[[], dict[str, Any]] = dict,
) -> None:  # fmt: skip
    """Train, look at 20 scenes now and then, at fresh ones in the end; the minutes are the learner's alone.

    Args:
        model: an algorithm of Stable-Baselines3.
        args: of `options`.
        actions: of an episode.
        env: of the looks.
        test: of the fresh scenes.
        best: keep the policy of the best look, not of the last.
        beside: returns more figures of a look.
    """
    args.out.parent.mkdir(parents=True, exist_ok=True)
    curve, minutes = list[dict[str, Any]](), 0.0
    while model.num_timesteps < actions * args.episodes:
        began = time.process_time()
        model.learn(actions * min(args.every, args.episodes), reset_num_timesteps=not curve)
        minutes += (time.process_time() - began) / 60
        row = {"episodes": model.num_timesteps // actions, "cpu_minutes": minutes}
        row["held_of_20"] = held(model, env, range(min(20, args.trials)))
        curve.append(row | beside())
        print(curve[-1], flush=True)
        if not best or row["held_of_20"] >= max(own["held_of_20"] for own in curve):
            model.save(args.out)
    fresh = held(type(model).load(args.out, device="cpu"), test, range(1000, 1000 + args.trials))
    print(fresh, "of", args.trials, "fresh scenes held")
    told = {"settings": vars(args), "curve": curve, "fresh": fresh, "of": args.trials}
    args.out.with_name(f"{args.out.name}_curve.json").write_text(json.dumps(told, indent=1, default=str))
