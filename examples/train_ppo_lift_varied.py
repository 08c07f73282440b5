"""PPO of Stable-Baselines3 on `LiftVaried`: an episode is one action, a whole grasp at a place that has to be seen.

`dexgrasp evaluate --agents ppo:out/varied.zip --wrappers examples.train_ppo_lift_varied.Place` plays what it learned.
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
PARSER.add_argument("--objects", nargs=2, default=["drawn-1000..1039", "drawn-0..39"], help="train, test")
PARSER.add_argument("--episodes", type=int, default=4000, help="one action each")
PARSER.add_argument("--every", type=int, default=500, help="episodes from one look to the next")
PARSER.add_argument("--trials", type=int, default=200, help="fresh scenes in the end")
PARSER.add_argument("--seed", type=int, default=0)
PARSER.add_argument("--out", type=Path, default=Path("out/varied"))
TURNS = np.deg2rad(np.arange(-90, 90, 5))  # of the palm from where it faces at home, -45 degrees
WAYS = np.stack([np.cos(TURNS - np.pi / 4), np.sin(TURNS - np.pi / 4)], axis=1)


class Place(gym.ObservationWrapper):
    """Observation (9,) of the object as a box; an action is told from it: 6 cm along and across, height, turn."""

    observation_space = gym.spaces.Box(-10.0, 10.0, (9,), np.float32)

    def step(self, action: np.ndarray) -> tuple:
        """Grasp beside the object's place, the palm 12 to 17 cm high, the hand half closed or more; clip the rest."""
        (x, y, turn), (a, b), yaw = self.place, 0.06 * action[:2], (2 * self.place[2] - 1) * np.pi / 4
        x, y = x + (np.cos(yaw) * a - np.sin(yaw) * b) / 0.12, y + (np.sin(yaw) * a + np.cos(yaw) * b) / 0.23
        told = [x, y, 0.4 * action[2] - 0.6, turn + 0.5 * action[3], action[4], *(0.5 * action[5:] + 0.5)]
        return super().step(np.clip(told, -1.0, 1.0).astype(np.float32))

    def observation(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """Return x, y and the turn that closes on the narrowest side, in units of the action; its sine ...; sides."""
        (x, y, z, *q), size = observation["object_pose"], observation["object_size"]
        R = Rotation.from_quat(q, scalar_first=True).as_matrix()
        widths = np.abs(WAYS @ R[:2]) @ size
        k = np.argmin(np.where(widths < 1.03 * widths.min() + 0.003, np.abs(TURNS), np.inf))  # turns least
        turn, top = TURNS[k], z + 0.5 * np.abs(R[2]) @ size
        self.place = np.array([(x - 0.51) / 0.12, y / 0.23, turn / (np.pi / 2)])
        sides = np.sin(turn), np.cos(turn), 10 * widths[k], 10 * widths[k - 18], 10 * top, 10 * z
        return np.array([*self.place, *sides], np.float32)


def held(model: PPO, env: gym.Env, scenes: range) -> int:
    """Return in how many scenes, by seed, the policy's mean action ends with the object held."""
    looks = (env.reset(seed=seed)[0] for seed in scenes)
    return sum(env.step(model.predict(look, deterministic=True)[0])[4]["is_success"] for look in looks)


class Looks(BaseCallback):
    """Looks at 20 scenes now and then, and noise of actions, whose logarithm goes from -1.2 to -2."""

    def __init__(self, other: gym.Env, every: int) -> None:
        super().__init__()
        self.other, self.every, self.curve, self.began = other, every, list[dict](), time.process_time()

    def _on_rollout_start(self) -> None:
        self.model.policy.log_std.data.fill_(-1.2 - 0.8 * self.num_timesteps / self.locals["total_timesteps"])

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
    env, test = (Place(gym.make("DexGrasp/LiftVaried-v1", objects=o, obs_mode="state")) for o in args.objects)
    steps, rate = min(250, args.episodes), lambda left: 1e-3 * left + 5e-5
    model = PPO("MlpPolicy", env, rate, steps, min(50, steps), target_kl=0.1, seed=args.seed, device="cpu")
    start = torch.tensor([0.2, -0.56, -0.65, 0.0, 0.5, 1.0, 1.0])  # the best of `LiftOnce`: it begins there
    model.policy.action_net.load_state_dict({"weight": torch.zeros(7, 64), "bias": start})
    model.learn(args.episodes, looks := Looks(test, args.every))
    save_checkpoint(model, f"{args.out}.zip")
    print(fresh := held(model, test, range(3000, 3000 + args.trials)), "of", args.trials, "fresh held")
    told = {"settings": vars(args), "curve": looks.curve, "fresh": fresh}
    args.out.with_name(f"{args.out.name}_curve.json").write_text(json.dumps(told, indent=1, default=str))


if __name__ == "__main__":
    main()
