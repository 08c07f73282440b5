"""`--env.type=dexgrasp` of LeRobot's scripts: protocols are suites, objects are tasks."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import gymnasium as gym

from dexgrasp.evaluation.protocol import get_protocol
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.learning.lerobot.env import OBS_TYPES, LeRobotEnv
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import from_extra
from dexgrasp_env.scene.constants import CONTROL_PERIOD
from dexgrasp_env.valid import check, number, one_of

with from_extra():
    from lerobot.configs import FeatureType, PolicyFeature
    from lerobot.envs.configs import EnvConfig
    from lerobot.utils.constants import ACTION, OBS_ENV_STATE, OBS_IMAGES, OBS_STATE

_RATE = round(1 / CONTROL_PERIOD)  # Hz


@EnvConfig.register_subclass("dexgrasp")
@dataclass
class DexGraspEnv(EnvConfig):
    """Configuration of the environments for LeRobot's scripts.

        lerobot-eval --env.type=dexgrasp --env.task=lift --env.objects=seen --policy.path=DIR --seed=0

    Episode k of an object is trial k of `dexgrasp evaluate` with seed `evaluation_seed`, counted from LeRobot's own
    `--seed`.

    Attributes:
        task: protocols, with commas between.
        fps: control steps of a second, always 20.
        objects: names, sets or mesh files, with commas between.
        evaluation_seed: of the scenes.
        obs_type: `environment_state_agent_pos`, `pixels_agent_pos` or `pixels_environment_state_agent_pos`.
        control_mode: what actions mean.
        episode_length: control steps; the protocol's by default.
        render_mode: rgb_array; none draws nothing, and films are black.
        robot: file of your cell, or of a robot.
        mount: how the hand sits on the arm's flange.
    """

    task: str | None = "lift"
    fps: int = _RATE
    objects: str = "ycb6"
    evaluation_seed: int = 0
    obs_type: str = "environment_state_agent_pos"
    control_mode: str = "joint_delta"
    episode_length: int | None = None
    render_mode: str = "rgb_array"
    robot: str | None = None
    mount: str | None = None

    def __post_init__(self) -> None:
        """Declare the features.

        Raises:
            InputError: for an unknown protocol, object, kind of observation or cell.
        """
        check("fps", self.fps, number(ge=_RATE, le=_RATE))
        check("render_mode", self.render_mode, one_of(("rgb_array", "none")))
        check("obs_type", self.obs_type, one_of(OBS_TYPES))
        env = self._vector(self._settings.objects[0], self._settings.parts[0])
        seen: Any = env.single_observation_space
        parts = {ACTION: env.single_action_space, **seen.spaces}
        # LeRobot records pictures under the names that policies know them by.
        parts |= {f"{OBS_IMAGES}.{name}": part for name, part in parts.pop("pixels", {}).items()}
        env.close()
        known = {
            ACTION: (ACTION, FeatureType.ACTION),
            "agent_pos": (OBS_STATE, FeatureType.STATE),
            "environment_state": (OBS_ENV_STATE, FeatureType.ENV),
        }
        for key, part in parts.items():
            self.features_map[key], kind = known.get(key, (key, FeatureType.VISUAL))
            self.features[key] = PolicyFeature(type=kind, shape=part.shape)

    @property
    def _settings(self) -> EvaluationSettings:
        return EvaluationSettings.of(
            ["random"], self.objects.split(","), seed=self.evaluation_seed, protocols=(self.task or "").split(","),
            robot=self.robot, mount=self.mount,
        )  # fmt: skip

    @property
    def gym_kwargs(self) -> Fields:
        """Keywords of `gym.make` that belong to the policy."""
        limit = {"max_episode_steps": self.episode_length} if self.episode_length else {}
        return {
            "obs_mode": OBS_TYPES[self.obs_type],
            "control_mode": self.control_mode,
            "render_mode": None if self.render_mode == "none" else self.render_mode,
            **limit,
        }

    def create_envs(self, n_envs: int, use_async_envs: bool = False) -> dict[str, dict[int, Any]]:
        """Return a vector environment for every protocol and object, made on first use."""
        settings = self._settings
        return {
            protocol: {
                k: _Deferred(partial(self._vector, target, protocol, n_envs, use_async_envs))
                for k, target in enumerate(settings.objects)
            }
            for protocol in settings.parts
        }

    def _vector(
        self, target: str, protocol: str, n_envs: int = 1, use_async_envs: bool = False
    ) -> gym.vector.VectorEnv:
        mode, more = ("async", {"context": "forkserver"}) if use_async_envs and n_envs > 1 else ("sync", {})
        return gym.make_vec(
            get_protocol(protocol).env_id, n_envs, mode, {"autoreset_mode": "SameStep", **more},
            [partial(LeRobotEnv, target=target, seed=self.evaluation_seed)],
            objects=[target], disable_env_checker=True, **self._settings.scene(protocol) | self.gym_kwargs,
        )  # fmt: skip


class _Deferred:
    """Vector environment that is made on first use: of many tasks one is open at a time."""

    def __init__(self, make: Callable[[], Any]) -> None:
        self._make = make

    @cached_property
    def _made(self) -> Any:
        return self._make()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._made, name)

    def close(self) -> None:
        """Close the environment, if it was made."""
        if made := vars(self).pop("_made", None):
            made.close()
