"""Policies trained with LeRobot, as agents: `lerobot:` and the folder that its scripts call `pretrained_model`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.agent import Agent, Info, Observation
from dexgrasp.data.demonstrations.lerobot_format import lerobot_observation, task_of
from dexgrasp.evaluation.protocol import agent_keywords
from dexgrasp_env.arrays import Fields, Single
from dexgrasp_env.errors import InputError, understood
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import expand, read_json_object


class LeRobotAgent(Agent):
    """Acts by a policy of LeRobot through its own processors, one environment at a time.

    Attributes:
        assumed: what had to be assumed of the environment, as nothing beside the policy says it; empty otherwise.
    """

    def __init__(self, spec: str, env_kwargs: Mapping[str, Any] | Sequence[str] = ()) -> None:
        """Open a policy.

        Args:
            spec: `lerobot:FOLDER`.
            env_kwargs: keywords of `gym.make` that it was trained with, where its folder does not say so.

        Raises:
            InputError: if there is no such policy, or LeRobot is not installed.
        """
        folder = expand(spec.removeprefix("lerobot:"))
        if not (folder / "config.json").is_file():
            raise InputError(
                f"{folder} holds no policy of LeRobot (no config.json): name a folder pretrained_model"
            )
        with from_extra():
            from lerobot.configs.policies import PreTrainedConfig
            from lerobot.policies.factory import get_policy_class, make_pre_post_processors
        with understood(folder, "a policy of LeRobot"):
            config = PreTrainedConfig.from_pretrained(folder)
            config.device = "cpu"
            self._policy = get_policy_class(config.type).from_pretrained(folder, config=config).eval()
            here = {"preprocessor_overrides": {"device_processor": {"device": "cpu"}}}
            self._before, self._after = make_pre_post_processors(config, pretrained_path=str(folder), **here)
        self._acts = tuple(config.output_features["action"].shape)
        stated = agent_keywords(env_kwargs, _trained_in(folder), folder / "train_config.json")
        modes = {"observation.environment_state": "state", "observation.image": "rgbd"}
        names = " ".join(config.input_features)
        seen = [mode for key, mode in modes.items() if key in names]
        doubt = "does not say what its actions mean: played with control_mode=joint_delta, unless --env-kwargs does"
        self.assumed = "" if "control_mode" in stated else f"{folder} {doubt}"
        settings = {"obs_mode": "+".join(seen) or "state", "control_mode": "joint_delta"}
        self.env_settings = settings | stated  # type: ignore[misc]  # of the instance here

    @classmethod
    def files(cls, name: str) -> list[Path]:
        """Return the configurations and weights in a policy's folder."""
        folder = expand(name.removeprefix("lerobot:"))
        return sorted((*folder.glob("*.json"), *folder.glob("*.safetensors")))

    def check_info(self, info: Info) -> None:
        """Refuse an environment with other actions.

        Raises:
            InputError: saying both.
        """
        here = info["action_space"].shape
        if here != self._acts:
            raise InputError(f"the policy of LeRobot has actions of shape {self._acts}, here they are {here}")

    def seed(self, seed: int) -> None:
        """Seed the draws of policies that sample."""
        import torch

        torch.manual_seed(seed)

    def reset(self, observation: Observation, info: Info) -> None:
        """Begin an episode."""
        self._policy.reset()

    def act(self, observation: Observation) -> Single:
        """Return the next action."""
        import torch
        from lerobot.envs.utils import preprocess_observation

        # No agent is told the object's name, which a policy that reads its task may have learned by.
        seen = preprocess_observation(lerobot_observation(observation)) | {"task": [task_of("the object")]}
        with torch.inference_mode():
            action = self._after(self._policy.select_action(self._before(seen)))
        return np.asarray(action[0].cpu())


def _trained_in(folder: Path) -> Fields:
    """Return the keywords that the training says of its environment."""
    path = folder / "train_config.json"
    env = (read_json_object(path, "train it again") if path.is_file() else {}).get("env") or {}
    return {"control_mode": env["control_mode"]} if env.get("type") == "dexgrasp" else {}
