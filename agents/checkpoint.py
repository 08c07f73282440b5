"""Policies trained with Stable-Baselines3, as agents.

A checkpoint is a zip with pickled parts; `checkpoint_reader` sees to it that none of them runs. What it was trained in
says the record beside it (`learning.reinforcement.env_record`); where there is none, its spaces and the user do.
"""

import ast
import importlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from gymnasium import spaces, wrappers

from dexgrasp.agent import Agent, Info, Observation
from dexgrasp.agents.checkpoint_reader import counted, harmless_objects, read_settings, statistics_files
from dexgrasp.agents.wrapped import Player, Relay, wrapped
from dexgrasp.evaluation.protocol import AGENT_KEYS, agent_keywords
from dexgrasp.learning.reinforcement.env_record import EnvRecord, WrapperRecord, read_record, vec_wrapper
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError, first_line, unknown_name
from dexgrasp_env.extras import require_extra
from dexgrasp_env.files import expand
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.tasks.observations import FLAT
from dexgrasp_env.tasks.settings import LiftSettings

ALGORITHMS = {
    **dict.fromkeys(("ppo", "sac", "td3", "ddpg", "a2c"), "stable_baselines3"),
    **dict.fromkeys(("tqc", "recurrentppo", "trpo", "crossq", "ars"), "sb3_contrib"),
}
"""Algorithm -> the library that has it."""
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
            spec: `path.zip`, or `algorithm:path.zip` where the path does not tell the algorithm.
            env_kwargs: keywords of `gym.make` that it was trained with, where no record says so; also `KEY=VALUE`.
            wrappers: likewise, the innermost first, as `RescaleAction(min_action=-0.5, max_action=0.5)`; those of
                one's own as `module.Class(...)`, which runs that module.

        Raises:
            InputError: if there is no such file, it is no checkpoint, Stable-Baselines3 is not installed, or what is
                given contradicts what the checkpoint says of itself.
        """
        algorithm, self._path = _split(spec)
        if not self._path.is_file():
            raise InputError(
                f"checkpoint {self._path} does not exist: valid is a .zip file of Stable-Baselines3"
            )
        self._policy = _open(self._path, algorithm or _guess(self._path))
        self._own: frozenset[str] = frozenset()
        self.assumed = ""
        self._record = self._with_wrappers(
            self._known(agent_keywords(env_kwargs)), tuple(map(_parsed, wrappers))
        )
        self.env_settings = {  # type: ignore[misc]  # of the instance here
            key: value
            for key, value in self._record.env.items()
            if (key.endswith("_mode") and key != "reward_mode") or value != _DEFAULTS[key]
        }
        self._relay: Any = None
        self._player: Any = None
        self._seed: int | None = None

    def _known(self, given: Fields) -> EnvRecord:
        """Return what the checkpoint was trained in: as its record says, else as its spaces, and the user, do."""
        beside = self._path.with_suffix(".json")
        if beside.is_file():
            record = read_record(beside)
            self._agree(record.env, given, str(beside))
            return record
        statistics = vec_wrapper(counted(self._path))
        stated = _of_spaces(self._policy)
        self._agree({key: stated[key] for key in stated if key != "obs_mode"}, given, "its action space")
        known = stated | given
        if "control_mode" not in known:
            raise InputError(
                f"{self._path} was trained on actions that a wrapper changed, or elsewhere, and does not tell their "
                "meaning: say --env-kwargs control_mode=joint_delta if that is what they are, and the wrapper with "
                "--wrappers, or name an agent of your own, package.module:Class"
            )
        if not statistics and read_settings(self._path).get("_last_original_obs"):
            raise InputError(
                f"{self._path} was trained under VecNormalize, whose counts are not beside it: save them as "
                f"{self._path.with_suffix('.pkl').name}, or all with save_checkpoint() of dexgrasp"
            )
        words = ", ".join(f"{key}={value}" for key, value in (_DEFAULTS | known).items() if key in AGENT_KEYS)
        words += ", what VecNormalize counted" if statistics else ", no VecNormalize"
        self.assumed = (
            f"{self._path} says no more of what it was trained in than its spaces: played with {words}; --env-kwargs "
            "and --wrappers say otherwise, and save_checkpoint() of dexgrasp records it"
        )
        return EnvRecord(_DEFAULTS | known, vec_wrappers=(statistics,) if statistics else ())

    def _agree(self, known: Fields, given: Fields, source: str) -> None:
        for key in given.keys() & known.keys():
            if given[key] != known[key]:
                raise InputError(
                    f"{self._path} was trained with {key}={known[key]}, as {source} says, which {key}={given[key]} "
                    "contradicts"
                )

    def _with_wrappers(self, record: EnvRecord, given: tuple[WrapperRecord, ...]) -> EnvRecord:
        """Return a record with the wrappers that the user names, which are those of the record if it has any."""
        if not given:
            return record
        names = [each.short for each in record.wrappers]
        if record.id and names != [each.short for each in given]:
            raise InputError(
                f"{self._path} was trained in {', '.join(names) or 'no wrappers'}, as its record says, which "
                "--wrappers contradicts"
            )
        self._own = frozenset(each.name for each in given)
        states = [each.state for each in record.wrappers] or [Fields()] * len(given)
        return replace(
            record,
            wrappers=tuple(replace(each, state=own) for each, own in zip(given, states, strict=True)),
        )

    def seed(self, seed: int) -> None:
        """Seed the policy's own draws, and its wrappers'."""
        self._policy.set_random_seed(seed)
        self._seed = seed

    def check_info(self, info: Info) -> None:
        """Refuse an environment that the policy was not trained in; wrap what stands for it otherwise.

        Raises:
            InputError: for another robot, other observations or actions, or a wrapper that cannot be made.
        """
        cell, policy, record = info.get("cell"), self._policy, self._record
        here = {"robot": cell.robot.stamp if isinstance(cell, Cell) else None, "mount": info.get("mount")}
        for part, value in here.items():
            theirs = getattr(record, part)
            if None not in (value, theirs) and theirs != value:
                raise InputError(
                    f"{self._path} was trained with {part} {theirs}: here it is {value}, give its own with --{part}"
                )
        if record.wrappers and "action_space" not in info:
            raise InputError(
                "the policy acts through wrappers: reset() needs the info of the environment's reset"
            )
        seen, known = info.get("observation_space", policy.observation_space), policy.observation_space
        if not record.id and not record.wrappers and _shapes(known).items() <= _shapes(seen).items():
            seen = known  # some keys of many
        self._relay = Relay(seen, info.get("action_space", policy.action_space), record)
        self._envs = wrapped(self._relay, record, self._own)
        theirs, ours = _shapes(known), _shapes(self._envs.observation_space)
        if other := sorted(key for key in theirs if theirs[key] != ours.get(key)):
            raise InputError(
                f"{self._path} was trained on observations {_words(theirs, other)}, here they are "
                f"{_words(ours, other) if set(other) <= ours.keys() else 'of ' + ', '.join(ours)}: name the wrappers "
                "between, as --wrappers FlattenObservation"
            )
        acts, can = policy.action_space, self._envs.action_space
        if not all(np.array_equal(getattr(acts, end), getattr(can, end)) for end in ("low", "high")):
            raise InputError(
                f"{self._path} was trained on actions {acts}, here they are {can}: name the wrapper that changed "
                "them, as --wrappers 'RescaleAction(min_action=-0.5, max_action=0.5)'"
            )

    def reset(self, observation: Observation, info: Info) -> None:
        """Begin an episode; nothing of the last one is kept.

        Raises:
            InputError: as `check_info`.
        """
        if self._player:
            self._player.end()
        if self._relay is None:
            self.check_info(info)
        self._envs.seed(self._seed)
        self._player = Player(self._policy, self._envs, self._relay, observation)

    def act(self, observation: Observation) -> Any:
        """Return the action that the policy's mean one comes to behind its wrappers."""
        if self._player is None:
            self.reset(observation, {})
        known, seen = self._relay.observation_space, cast("Any", observation)
        if isinstance(known, spaces.Box) and np.shape(seen) != known.shape:
            raise InputError(
                f"the checkpoint was trained on {known.shape[0]} features, of another control_mode"
            )
        return self._player.action(observation)


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


def _shapes(space: spaces.Space[Any]) -> Fields:
    return (
        {key: part.shape for key, part in space.items()}
        if isinstance(space, spaces.Dict)
        else {"": space.shape}
    )


def _words(shapes: Fields, keys: Sequence[str]) -> str:
    return ", ".join(f"{key} {shapes[key]}".strip() for key in keys)


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
    named = [name for name in ALGORITHMS if f".{name}." in policy]
    # Several share their policies: what else they hold tells them apart.
    if "recurrent" in policy:
        named = ["recurrentppo"]
    elif "common" in policy:
        named = ["trpo" if "cg_max_steps" in data else "ppo" if "clip_range" in data else "a2c"]
    found = named or [name for name in ALGORITHMS if name in path.stem.lower()]
    if found:
        return found[-1]
    raise InputError(
        f"cannot tell the algorithm of {path}: write it before, e.g. ppo:{path}; valid are {', '.join(ALGORITHMS)}"
    )


def _open(path: Path, algorithm: str) -> Any:
    settings, library = read_settings(path), ALGORITHMS[algorithm]
    require_extra("learning", f"checkpoint {path}")
    objects = harmless_objects(path, settings)
    try:
        module = importlib.import_module(library)
        kind = next(getattr(module, name) for name in module.__all__ if name.lower() == algorithm)
        policy = kind.load(path, device="cpu", custom_objects=objects)
    except ImportError:
        raise InputError(f"checkpoint {path} needs {library}: pip install 'dexgrasp[learning]'") from None
    except Exception as error:
        raise InputError(
            f"{path} cannot be opened as a {algorithm} checkpoint: {first_line(error)[:160]}"
        ) from error
    if not isinstance(policy.action_space, spaces.Box):
        raise InputError(f"{path} has actions {policy.action_space}: valid are boxes of numbers")
    return policy


def _of_spaces(policy: Any) -> Fields:
    """Return the environment settings that the spaces of a policy tell."""
    seen = policy.observation_space
    keys = seen.keys() if isinstance(seen, spaces.Dict) else ()
    modes = {"cloud": "pointcloud", "rgb": "rgbd", "depth": "depth"}
    cameras = [mode for key, mode in modes.items() if key in keys][:1]
    known = ["state"] if "object_pose" in keys or "observation" in keys or not cameras else []
    told = ("control_mode", "frame_skip", "action_scale", "hold")
    own = {key: getattr(policy.action_space, key, None) for key in told}
    whole = "grasp" in str(own["control_mode"]) or own["hold"] not in (None, 1)  # what is learned on features
    flat = whole and isinstance(seen, spaces.Box)
    stated = {"obs_mode": FLAT if flat else "+".join(known + cameras)}
    return stated | {key: value for key, value in own.items() if value is not None}
