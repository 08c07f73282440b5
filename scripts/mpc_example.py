"""Sampling-based predictive control on saved states: plan in many copies of the present, act once, plan again.

    python scripts/mpc_example.py [--object sugar_box] [--steps 40] [--samples 32] [--horizon 6]

The model is the simulator itself: `get_state` of the environment goes into every environment of a native vector
environment, which tries one sequence of actions each; the cross-entropy method keeps the best and narrows around them.
"""

import argparse
from typing import Any

import gymnasium as gym
import numpy as np

import dexgrasp_env  # noqa: F401  (registers the environments)

ELITE = 0.2  # share of the samples that the next ones are drawn around
SPREAD = 0.3  # of the actions at the start, of 1


def plan(envs: Any, state: Any, mean: np.ndarray, rounds: int, rng: np.random.Generator) -> np.ndarray:
    """Return the mean (H, 23) of the best sequences of actions from a state."""
    samples, spread = envs.num_envs, np.full_like(mean, SPREAD)
    for _ in range(rounds):
        tries = np.clip(mean + spread * rng.standard_normal((samples, *mean.shape)), -1, 1)
        tries[0] = mean
        envs.set_state(state)
        returns = sum(envs.step(tries[:, k])[1] for k in range(mean.shape[0]))
        best = tries[np.argsort(returns)[-max(2, int(ELITE * samples)) :]]
        mean, spread = best.mean(0), best.std(0) + 0.02
    return mean


def run(name: str, steps: int, samples: int, horizon: int, rounds: int = 2, seed: int = 0) -> list[float]:
    """Control one episode, and return its rewards."""
    rng = np.random.default_rng(seed)
    env = gym.make("DexGrasp/Lift-v2", objects=name)
    # A try that loses the object starts another episode: what that earns in so few steps is little.
    envs = gym.make_vec("DexGrasp/Lift-v2", num_envs=samples, objects=name, max_episode_steps=None)
    env.reset(seed=seed)
    mean, rewards = np.zeros((horizon, 23)), []
    for _ in range(steps):
        mean = plan(envs, env.unwrapped.get_state(), mean, rounds, rng)  # type: ignore[attr-defined]
        _, reward, terminated, truncated, _ = env.step(mean[0].astype(np.float32))
        rewards.append(float(reward))
        if terminated or truncated:
            break
        mean = np.concatenate([mean[1:], mean[-1:]])
    envs.close()
    return rewards


def main() -> None:
    """Control an episode and say how the reward went."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--object", default="sugar_box")
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--samples", type=int, default=32)
    parser.add_argument("--horizon", type=int, default=6)
    args = parser.parse_args()
    rewards = run(args.object, args.steps, args.samples, args.horizon)
    print(f"{len(rewards)} steps: reward {rewards[0]:.3f} at first, {rewards[-1]:.3f} at last")


if __name__ == "__main__":
    main()
