"""Policies trained with Stable-Baselines3, as agents.

A checkpoint is a zip with pickled parts; `checkpoint_reader` sees to it that none of them runs.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from dexgrasp.agent import Agent, Observation
from dexgrasp_env.arrays import Fields, Single
from dexgrasp_env.errors import InputError, first_line, unknown_name
from dexgrasp_env.extras import require_extra
from dexgrasp_env.files import expand, read_json_object
from dexgrasp_env.scene.constants import CONTROL_STEPS
from dexgrasp_env.tasks.observations import FLAT

from .checkpoint_reader import counted, harmless_objects, read_settings, statistics_files

ALGORITHMS = ("ppo", "sac", "td3", "ddpg", "a2c")


class CheckpointAgent(Agent):
    """Acts by a Stable-Baselines3 policy, without exploration noise.

    Its `env_settings` are those it was trained with, as far as its spaces tell; a file of the checkpoint's name ending
    in `.json` may say more (`{"observe": "reset"}`). What `VecNormalize` had counted, saved as `NAME.pkl` or
    `vecnormalize.pkl` beside it, is used.
    """

    def __init__(self, spec: str) -> None:
        """Open a checkpoint.

        Args:
            spec: `path.zip`, or `algorithm:path.zip` where the path does not tell the algorithm.

        Raises:
            InputError: if there is no such file, it is no checkpoint, or Stable-Baselines3 is not installed.
        """
        algorithm, path = _split(spec)
        if not path.is_file():
            raise InputError(f"checkpoint {path} does not exist: valid is a .zip file of Stable-Baselines3")
        self._policy = _open(path, algorithm or _guess(path))
        self._counted = counted(path)
        known, beside = _env_settings_of(self._policy), path.with_suffix(".json")
        if beside.is_file():
            known |= read_json_object(beside, 'it holds environment settings, e.g. {"obs_mode": "state"}')
        if "control_mode" not in known:
            raise InputError(
                f"{path} was trained on actions that a wrapper changed, or elsewhere, and does not tell their meaning: "
                f'write {{"control_mode": "joint_delta"}} into {beside} if that is what they are, or name an agent of '
                "your own, package.module:Class"
            )
        self.env_settings = known  # type: ignore[misc]  # of the instance here

    def seed(self, seed: int) -> None:
        """Seed the policy's own draws."""
        self._policy.set_random_seed(seed)

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Begin an episode; nothing of the last one is kept."""

    def act(self, observation: Observation) -> Single:
        """Return the policy's mean action."""
        space = self._policy.observation_space
        keys = space.spaces if isinstance(space, spaces.Dict) else {}
        if not keys and getattr(observation, "shape", None) != space.shape:
            raise InputError(
                f"the checkpoint was trained on {space.shape[0]} features, of another control_mode"
            )
        if keys and (missing := sorted(keys - observation.keys())):
            raise InputError(
                f"the checkpoint was trained with {', '.join(missing)}, which the environment lacks"
            )
        seen: Any = {key: observation[key] for key in keys} or observation
        if self._counted is not None:
            seen = self._counted.normalize_obs(seen)
        action, _ = self._policy.predict(seen, deterministic=True)
        return np.asarray(action, dtype=np.float32)


def checkpoint_files(spec: str) -> list[Path]:
    """Return the files that a checkpoint's name stands for: itself, its settings, and what `VecNormalize` counted."""
    _, path = _split(spec)
    return [path, path.with_suffix(".json"), *statistics_files(path)]


def _split(spec: str) -> tuple[str | None, Path]:
    head, separator, tail = spec.partition(":")
    if not separator or Path(spec).is_file() or len(head) == 1:  # a single letter is a Windows drive
        return None, expand(spec)
    if head not in ALGORITHMS:
        raise unknown_name("algorithm of a checkpoint", head, ALGORITHMS)
    return head, expand(tail)


def _guess(path: Path) -> str:
    """Find the algorithm in the names of the policy class and of the file; nothing is unpickled for it."""
    data = read_settings(path)
    about = data.get("policy_class")
    policy = str(about.get("__module__", "")) if isinstance(about, dict) else ""
    candidates = [name for name in ALGORITHMS if f".{name}." in policy or name in path.stem.lower()]
    if candidates:
        return candidates[0]
    # PPO and A2C share their policies; PPO alone has a clip range.
    if "common" in policy:
        return "ppo" if "clip_range" in data else "a2c"
    raise InputError(
        f"cannot tell the algorithm of {path}: write it before, e.g. ppo:{path}; valid are {', '.join(ALGORITHMS)}"
    )


def _open(path: Path, algorithm: str) -> Any:
    settings = read_settings(path)
    require_extra("learning", f"checkpoint {path}")
    import stable_baselines3

    objects = harmless_objects(path, settings)
    try:
        policy = getattr(stable_baselines3, algorithm.upper()).load(
            path, device="cpu", custom_objects=objects
        )
    except Exception as error:
        raise InputError(
            f"{path} cannot be opened as a {algorithm} checkpoint: {first_line(error)[:160]}"
        ) from error
    if not isinstance(policy.observation_space, spaces.Dict) and not _is_flat(policy):
        raise InputError(
            f"{path} was not trained on this environment's dict observations: use MultiInputPolicy, or its features"
        )
    return policy


def _is_flat(policy: Any) -> bool:
    """Return whether a policy was trained on `obs_mode="features"`, with actions of ours."""
    space = policy.observation_space
    return (
        isinstance(space, spaces.Box)
        and len(space.shape) == 1
        and hasattr(policy.action_space, "control_mode")
    )


def _env_settings_of(policy: Any) -> Fields:
    """Return the environment settings that the spaces of a policy tell."""
    if _is_flat(policy):
        return {"obs_mode": FLAT, **_of_actions(policy.action_space)}
    keys = policy.observation_space.keys()
    seen = [
        mode for mode, key in {"pointcloud": "cloud", "rgbd": "rgb", "depth": "depth"}.items() if key in keys
    ][:1]
    known = ["state"] if "object_pose" in keys or "observation" in keys or not seen else []
    return {"obs_mode": "+".join(known + seen), **_of_actions(policy.action_space)}


def _of_actions(space: Any) -> Fields:
    """Return what an action space tells beyond what is usual."""
    usual = {"control_mode": None, "frame_skip": CONTROL_STEPS, "action_scale": 1.0, "hold": 1}
    own = {key: getattr(space, key, value) for key, value in usual.items()}
    return {key: value for key, value in own.items() if value != usual[key]}
