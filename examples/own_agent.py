"""An agent of your own: a class with `reset` and `act`, played by hand for one episode."""

from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

import dexgrasp_env  # noqa: F401  (registers the environments)


class Hover:
    """Move the palm over the object, then close the hand."""

    env_settings: ClassVar = {"obs_mode": "state", "control_mode": "ee_delta"}

    def reset(self, observation: dict[str, Any], info: dict[str, Any]) -> None:
        """Forget the last episode."""
        self.steps = 0

    def act(self, observation: dict[str, Any]) -> np.ndarray:
        """Return 3 numbers of translation, 3 of rotation, 16 joints of the hand."""
        self.steps += 1
        above = observation["object_pose"][:3] + np.array([0.0, 0.0, 0.12])
        action = np.zeros(22, np.float32)
        action[:3] = np.clip((above - observation["palm_pose"][:3]) / 0.025, -1.0, 1.0)
        action[6:] = 0.3 if self.steps > 60 else -0.2  # of the joints' ranges
        return action


def main() -> None:
    """Play 80 control steps and print the rewards by term."""
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", **Hover.env_settings)
    observation, info = env.reset(seed=0)
    agent = Hover()
    agent.reset(observation, info)
    for _ in range(80):
        observation, _, _, _, info = env.step(agent.act(observation))
    print(info["stage"], info["object_height"], info["reward_terms"])
    env.close()


if __name__ == "__main__":
    main()
