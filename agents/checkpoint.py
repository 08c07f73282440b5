"""Policies trained with Stable-Baselines3, as agents.

A checkpoint is a zip with pickled parts; `checkpoint_reader` sees to it that none of them runs. What it was trained in
says the record beside it (`learning.reinforcement.env_record`); where there is none, its spaces and the user do.
"""

import ast
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces, wrappers

from dexgrasp.agent import Agent, Info, Observation
from dexgrasp.agents.checkpoint_reader import counted, open_policy, read_settings, statistics_files
from dexgrasp.agents.wrapped import Relay, wrapped
from dexgrasp.evaluation.protocol import AGENT_KEYS, agent_keywords
from dexgrasp.learning.reinforcement.env_record import EnvRecord, WrapperRecord, read_record, vec_wrapper
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import expand
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.tasks.observations import FLAT
from dexgrasp_env.tasks.settings import LiftSettings

with from_extra():
    from stable_baselines3.common.utils import set_random_seed

ALGORITHMS = ("ppo", "sac", "td3", "ddpg", "a2c", "tqc", "recurrentppo", "trpo", "crossq", "ars")
"""What may stand before the path of a checkpoint, which tells its policy itself."""
_TOLD = ("control_mode", "frame_skip", "action_scale", "hold")
"""Settings that action spaces of ours have as attributes."""
_DEFAULTS = {key: LiftSettings.__dataclass_fields__[key].default for key in AGENT_KEYS}


class CheckpointAgent(Agent):
    """Acts by a Stable-Baselines3 policy, without exploration noise, behind the wrappers that it was trained in.

    Attributes:
        assumed: what had to be assumed of the environment, as nothing beside the checkpoint says it; empty otherwise.
    """

    def __init__(
        self, spec: str, env_kwargs: Mapping[str, Any] | Sequence[str] = (), wrappers: Sequence[str] = ()
    ) -> None:
        """Open a checkpoint.

        Args:
            spec: `path.zip`, or `algorithm:path.zip`.
            env_kwargs: keywords of `gym.make` that it was trained with, where no record says so; also `KEY=VALUE`.
            wrappers: likewise, the innermost first, as `RescaleAction(min_action=-0.5, max_action=0.5)`; those of
                one's own as `module.Class(...)`, which runs that module.

        Raises:
            InputError: if there is no such file, it is no checkpoint, Stable-Baselines3 is not installed, or what is
                given contradicts what the checkpoint says of itself.
        """
        self._path = _path(spec)
        if not self._path.is_file():
            raise InputError(
                f"checkpoint {self._path} does not exist: valid is a .zip file of Stable-Baselines3"
            )
        self._policy = open_policy(self._path)
        self.assumed = ""
        beside = self._path.with_suffix(".json")
        if beside.is_file():
            record = read_record(beside)
            agent_keywords(env_kwargs, record.env, beside)
        else:
            record = self._foreign(env_kwargs)
        named = tuple(map(_parsed, wrappers))
        self._own = frozenset(each.name for each in named)
        self._record = self._with_wrappers(record, named) if named else record
        self.env_settings = {  # type: ignore[misc]  # of the instance here
            key: value
            for key, value in self._record.env.items()
            if key in ("obs_mode", "control_mode") or value != _DEFAULTS.get(key)
        }
        self._relay: Any = None
        self._seed: int | None = None

    def _foreign(self, given: Mapping[str, Any] | Sequence[str]) -> EnvRecord:
        """Return what a checkpoint was trained in that has no record: as its spaces, and the user, say."""
        statistics, policy = vec_wrapper(counted(self._path)), self._policy
        own = vars(policy.action_space)
        told = {key: own[key] for key in _TOLD if own.get(key) is not None}
        known = {"obs_mode": _obs_mode(policy.observation_space, told)}
        known |= agent_keywords(given, told, f"the action space of {self._path}")
        if "control_mode" not in known:
            raise InputError(
                f"{self._path} was trained on actions that a wrapper changed, or elsewhere, and does not tell their "
                "meaning: say --env-kwargs control_mode=joint_delta if that is what they are, and the wrapper with "
                "--wrappers, or name an agent of your own, package.module:Class"
            )
        settings = read_settings(self._path)  # those with a replay buffer keep the last observations anyway
        if not statistics and "gae_lambda" in settings and settings.get("_last_original_obs"):
            raise InputError(
                f"{self._path} was trained under VecNormalize, whose counts are not beside it: save them as "
                f"{self._path.with_suffix('.pkl').name}, or all with save_checkpoint() of dexgrasp"
            )
        words = ", ".join(f"{key}={value}" for key, value in (_DEFAULTS | known).items())
        words += ", what VecNormalize counted" if statistics else ", no VecNormalize"
        self.assumed = (
            f"{self._path} says no more of what it was trained in than its spaces: played with {words}; --env-kwargs "
            "and --wrappers say otherwise, and save_checkpoint() of dexgrasp records it"
        )
        return EnvRecord(known, vec_wrappers=statistics)

    def _with_wrappers(self, record: EnvRecord, named: Sequence[WrapperRecord]) -> EnvRecord:
        """Return a record with the wrappers that the user names, which are those of the record if it has any."""
        known = record.wrappers if record.id else named
        if [each.short for each in known] != [each.short for each in named]:
            raise InputError(
                f"{self._path} was trained in {', '.join(each.short for each in known) or 'no wrappers'}, as its "
                "record says, which --wrappers contradicts"
            )
        pairs = zip(named, known, strict=True)
        return replace(record, wrappers=tuple(replace(each, state=own.state) for each, own in pairs))

    def seed(self, seed: int) -> None:
        """Seed the policy's own draws, and its wrappers'."""
        set_random_seed(seed)
        self._seed = seed

    def check_info(self, info: Info) -> None:
        """Refuse an environment that the policy was not trained in; wrap what stands for it otherwise.

        Raises:
            InputError: for another robot, other observations or actions, or a wrapper that cannot be made.
        """
        cell, policy, record = info.get("cell"), self._policy, self._record
        here = {"robot": cell.robot.stamp if isinstance(cell, Cell) else None, "mount": info.get("mount")}
        for part, value in here.items():
            if None not in (value, own := getattr(record, part)) and own != value:
                raise InputError(
                    f"{self._path} was trained with {part} {own}: here it is {value}, give its own with --{part}"
                )
        if record.wrappers and "action_space" not in info:
            raise InputError(
                "the policy acts through wrappers: reset() needs the info of the environment's reset"
            )
        seen, known = info.get("observation_space", policy.observation_space), policy.observation_space
        acts = policy.action_space
        theirs = _parts(known, acts)
        if not record.wrappers and theirs.items() <= _parts(seen, acts).items():
            seen = known  # some keys of many
        self._relay = Relay(seen, info.get("action_space", acts), record)
        self._envs = wrapped(self._relay, record, self._own)
        ours = _parts(self._envs.observation_space, self._envs.action_space)
        for part, value in theirs.items():
            if ours.get(part) != value:
                seen = ours.get(part, f"of {', '.join(ours)}")
                raise InputError(
                    f"{self._path} was trained on {part} {value}, here they are {seen}: name the wrappers between, as "
                    "--wrappers FlattenObservation 'RescaleAction(min_action=-0.5, max_action=0.5)'"
                )

    def reset(self, observation: Observation, info: Info) -> None:
        """Begin an episode; nothing of the last one is kept.

        Raises:
            InputError: as `check_info`.
        """
        if self._relay is None:
            self.check_info(info)
        self._envs.seed(self._seed)
        self._relay.begin(self._policy, self._envs)

    def act(self, observation: Any) -> Any:
        """Return the action that the policy's mean one comes to behind its wrappers."""
        if self._relay is None:
            self.reset(observation, {})
        known = self._relay.observation_space.shape  # None with keys
        if known and np.shape(observation) != known:
            raise InputError(f"the checkpoint was trained on {known[0]} features, of another control_mode")
        return self._relay.action(observation)

    @classmethod
    def files(cls, name: str) -> list[Path]:
        """Return the files of a checkpoint: itself, its record, and what `VecNormalize` counted."""
        path = _path(name)
        return [path, path.with_suffix(".json"), *statistics_files(path)]


def _parsed(text: str) -> WrapperRecord:
    """Return the wrapper that is written as a call, `Name(key=value)` or `module.Class(key=value)`; nothing is run."""
    try:
        call = ast.parse(text if "(" in text else f"{text}()", mode="eval").body
        if not isinstance(call, ast.Call) or call.args:
            raise ValueError
        kwargs = {str(word.arg): ast.literal_eval(word.value) for word in call.keywords}
        module, _, name = ast.unparse(call.func).rpartition(".")
    except (SyntaxError, ValueError):
        raise InputError(
            f"wrapper {text!r}: valid is Name(key=value, ...) of gymnasium.wrappers, or module.Class(key=value, ...)"
        ) from None
    if not module:
        if not hasattr(wrappers, name):
            raise unknown_name("wrapper", name, wrappers.__all__)
        module = getattr(wrappers, name).__module__
    return WrapperRecord(f"{module}:{name}", kwargs)


def _parts(seen: spaces.Space[Any], acts: spaces.Space[Any]) -> Fields:
    """Return the shapes of observations, by key if they have any, and the space of actions."""
    parts = seen if isinstance(seen, spaces.Dict) else {"observations": seen}
    return {key: part.shape for key, part in parts.items()} | {"actions": acts}


def _path(spec: str) -> Path:
    head, separator, tail = spec.partition(":")
    if not separator or Path(spec).is_file() or len(head) == 1:  # a single letter is a Windows drive
        return expand(spec)
    if head not in ALGORITHMS:
        raise unknown_name("algorithm of a checkpoint", head, ALGORITHMS)
    return expand(tail)


def _obs_mode(seen: spaces.Space[Any], told: Fields) -> str:
    """Return the mode that has the keys of an observation space."""
    if not isinstance(seen, spaces.Dict):
        whole = "grasp" in str(told.get("control_mode")) or told.get("hold", 1) != 1
        return FLAT if whole else "state"  # what is learned on features
    known = ["state"] if {"object_pose", "observation"} & seen.keys() else []
    modes = {"cloud": "pointcloud", "rgb": "rgbd", "depth": "depth"}
    cameras = [mode for key, mode in modes.items() if key in seen][:1]
    return "+".join(known + cameras) or "state"
