"""PPO of Stable-Baselines3 on `LiftVaried`: an episode is one action, a whole grasp at a place that has to be seen.

`python examples/train_ppo_lift_varied.py` learns on forty drawn shapes and is looked at on forty others; it writes
`out/varied.zip`, an agent by its path (`dexgrasp evaluate --agents ppo:out/varied.zip --protocol varied --wrappers
examples.train_ppo_lift_varied.Place`), and its curve. Actions are told from where the object lies and how it is turned.
"""

import argparse
import json
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from scipy.spatial.transform import Rotation
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.learning.reinforcement.env_record import save_checkpoint

PARSER = argparse.ArgumentParser(description=__doc__)
PARSER.add_argument("--objects", nargs="+", default=["drawn-1000..1039"], help="names, sets, mesh files")
PARSER.add_argument("--test", nargs="+", default=["drawn-0..39"], help="objects to look at")
PARSER.add_argument("--episodes", type=int, default=4000, help="one action each")
PARSER.add_argument("--every", type=int, default=500, help="episodes from one look to the next")
PARSER.add_argument("--trials", type=int, default=200, help="fresh scenes in the end")
PARSER.add_argument("--seed", type=int, default=0)
PARSER.add_argument("--out", type=Path, default=Path("out/varied"))
TURNS = np.deg2rad(np.arange(-90, 90, 5))  # of the palm from where it faces at home, -45 degrees


class Place(gym.Wrapper):
    """Observation (10,) of the object as a box; an action is told from it: 6 cm along and across, height, turn."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        self.observation_space = gym.spaces.Box(-10.0, 10.0, (10,), np.float32)

    def reset(self, **how: object) -> tuple[np.ndarray, dict]:
        """Begin an episode."""
        observation, info = self.env.reset(**how)
        return self.look(observation), info

    def step(self, action: np.ndarray) -> tuple:
        """Grasp beside the object's place; what lies beyond the table's is cut off."""
        yaw = self.place[3] * np.pi / 2 - np.pi / 4
        (a, b), c, s = 0.06 * action[:2], np.cos(yaw), np.sin(yaw)
        moved = (c * a - s * b) / 0.12, (s * a + c * b) / 0.23, action[2], 0.5 * action[3]
        told = np.clip([*(self.place + moved), *action[4:]], -1.0, 1.0)
        observation, *rest = self.env.step(told.astype(np.float32))
        return self.look(observation), *rest

    def look(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """Return x, y, height, turn that closes on the narrowest side, in units of the action; its sine ...; sides."""
        (x, y, z, *quat), size = observation["object_pose"], observation["object_size"]
        R = Rotation.from_quat(quat, scalar_first=True).as_matrix()
        ways = np.stack([np.cos(TURNS - np.pi / 4), np.sin(TURNS - np.pi / 4)], axis=1)
        widths = np.abs(ways @ R[:2]) @ size
        k = np.argmin(np.where(widths < 1.03 * widths.min() + 0.003, np.abs(TURNS), np.inf))  # turns least
        turn, top = TURNS[k], z + 0.5 * np.abs(R[2]) @ size
        self.place = np.array([(x - 0.51) / 0.12, y / 0.23, (top - 0.155) / 0.065, turn / (np.pi / 2)])
        sides = np.sin(turn), np.cos(turn), 10 * widths[k], 10 * widths[k - 18], 10 * top, 10 * z
        return np.array([*self.place, *sides], np.float32)


def held(model: PPO, env: gym.Env, scenes: range) -> int:
    """Return in how many scenes, by seed, the policy's mean action ends with the object held."""
    looks = (env.reset(seed=seed)[0] for seed in scenes)
    return sum(env.step(model.predict(look, deterministic=True)[0])[4]["is_success"] for look in looks)


class Looks(BaseCallback):
    """Looks at 20 scenes now and then, and noise of actions, whose logarithm goes from -0.7 to -2."""

    def __init__(self, other: gym.Env, every: int) -> None:
        super().__init__()
        self.other, self.every, self.curve, self.began = other, every, list[dict](), time.process_time()

    def _on_rollout_start(self) -> None:
        left = 1.0 - self.num_timesteps / self.locals["total_timesteps"]
        self.model.policy.log_std.data.fill_(-2.0 + 1.3 * left)

    def _on_step(self) -> bool:
        if self.num_timesteps % self.every == 0:
            now = time.process_time()
            look = {"episodes": self.num_timesteps, "cpu_minutes": (now - self.began) / 60}
            self.curve.append(look | {"held_of_20": held(self.model, self.other, range(20))})
            print(self.curve[-1], flush=True)
            self.began += time.process_time() - now  # looks are no learning
        return True


def main() -> None:
    """Train, and look at fresh scenes in the end."""
    args = PARSER.parse_args()
    torch.set_num_threads(1)
    known = "DexGrasp/LiftVaried-v1"
    env, other = (Place(gym.make(known, objects=x, obs_mode="state")) for x in (args.objects, args.test))
    steps, rate = min(250, args.episodes), lambda left: 1e-3 * left + 5e-5
    own = {"n_steps": steps, "batch_size": min(50, steps), "learning_rate": rate, "target_kl": 0.1}
    model = PPO("MlpPolicy", env, **own, seed=args.seed, device="cpu")
    model.learn(args.episodes, looks := Looks(other, args.every))
    save_checkpoint(model, f"{args.out}.zip")
    fresh = held(model, other, range(1000, 1000 + args.trials))
    print(fresh, "of", args.trials, "fresh scenes held")
    told = {"settings": vars(args), "curve": looks.curve, "fresh": fresh}
    args.out.with_name(f"{args.out.name}_curve.json").write_text(json.dumps(told, indent=1, default=str))


if __name__ == "__main__":
    main()
