"""Record of the environment that a policy was trained in, as JSON beside its checkpoint: `ppo.json` of `ppo.zip`.

A checkpoint of Stable-Baselines3 does not describe the environment, and saves the statistics of `VecNormalize` as a
pickle. A record has the id and keywords of `gym.make`, wrappers by name with their arguments, and statistics as
numbers.
"""

import json
import pkgutil
import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from inspect import signature
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from dexgrasp.evaluation.protocol import AGENT_KEYS
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import jsonable, read_json_object, write_json
from dexgrasp_env.valid import Word, list_of, read

SCHEMA = 1
_IDLE = {
    "TimeLimit",
    "OrderEnforcing",
    "PassiveEnvChecker",
    "Autoreset",
    "RecordEpisodeStatistics",
    "RecordVideo",
    "RenderCollection",
    "HumanRendering",
    "ClipReward",
    "TransformReward",
    "NormalizeReward",
    "Monitor",
    "VecMonitor",
    "VecCheckNan",
    "VecVideoRecorder",
}
"""Wrappers that change neither observations nor actions."""


@dataclass(frozen=True)
class WrapperRecord:
    """Record of a wrapper.

    Attributes:
        name: `module:Class`.
        kwargs: of its constructor; None where they are unknown.
        state: running mean and variance by key of the observation, "" for one without keys.
    """

    name: Word
    kwargs: Fields | None = None
    state: Fields = field(default_factory=dict)

    @property
    def short(self) -> str:
        """Name of the class alone."""
        return self.name.rpartition(":")[2]


_Wrappers = Annotated[tuple[WrapperRecord, ...], list_of(WrapperRecord)]


@dataclass(frozen=True)
class EnvRecord:
    """Record of an environment.

    Attributes:
        env: the keywords that a policy may choose (`AGENT_KEYS`), complete.
        id: of `gym.make`.
        kwargs: of `gym.make`, as JSON holds them.
        robot: its stamp; None for any.
        mount: of the hand, by name; None for any.
        max_episode_steps: of an episode.
        wrappers: of each environment, innermost first, without those that change nothing for a policy.
        vec_wrappers: of Stable-Baselines3, around all environments, likewise.
        schema: version of this format.
    """

    env: Fields
    id: str = ""
    kwargs: Fields = field(default_factory=dict)
    robot: str | None = None
    mount: str | None = None
    max_episode_steps: int | None = None
    wrappers: _Wrappers = ()
    vec_wrappers: _Wrappers = ()
    schema: int = SCHEMA


def read_record(path: Path) -> EnvRecord:
    """Read a record.

    Raises:
        InputError: if it is damaged, or of another schema.
    """
    remedy = "where it is no record of save_checkpoint() of dexgrasp, rename it, and say --env-kwargs"
    return read(EnvRecord, read_json_object(path, remedy, None, SCHEMA), str(path))


def save_checkpoint(model: Any, path: str | Path) -> Path:
    """Save an algorithm of Stable-Baselines3, and beside it the record of its environment.

        save_checkpoint(PPO("MultiInputPolicy", env).learn(100_000), "ppo.zip")

    Args:
        model: the algorithm.
        path: of the zip; `.zip` is added where it is missing.

    Returns:
        Path of the record; `dexgrasp evaluate --agents ppo:ppo.zip` runs the policy as it was trained.

    Raises:
        InputError: if the environment is none of DexGrasp's; the zip is written all the same.
    """
    zipped = Path(f"{path}".removesuffix(".zip") + ".zip")
    model.save(zipped)
    return record_environment(model.get_env(), zipped)


def record_environment(env: Any, path: str | Path) -> Path:
    """Write the record of a vector environment of Stable-Baselines3 beside the zip of a checkpoint.

    Raises:
        InputError: if the environment is none of DexGrasp's.
    """
    vec_wrappers: _Wrappers = ()
    while hasattr(env, "venv"):
        vec_wrappers = vec_wrapper(env) + vec_wrappers
        env = env.venv
    settings, spec = attribute_of(env, "settings"), attribute_of(env, "spec")
    if settings is None or spec is None:
        raise InputError(
            "the environment is none of DexGrasp's, or was not made by gym.make: it is not recorded"
        )
    record = EnvRecord(
        {key: getattr(settings, key) for key in AGENT_KEYS},
        spec.id,
        jsonable(spec.kwargs),
        settings.cell.robot.stamp,
        settings.mount,
        spec.kwargs.get("max_episode_steps", spec.max_episode_steps),
        tuple(_wrapper(each, env) for each in spec.additional_wrappers if each.name not in _IDLE),
        vec_wrappers,
    )
    beside = Path(path).with_suffix(".json")
    write_json(beside, jsonable(record))
    return beside


def _as_json(kwargs: Fields | None) -> Fields | None:
    """Return arguments as JSON holds them; None where it cannot, as of a function."""
    try:
        return json.loads(json.dumps(kwargs, default=_packed))
    except AttributeError:
        return None


def _packed(array: Any) -> Fields:
    if isinstance(array, type) and issubclass(array, np.generic):
        return {"dtype": array.__name__}
    return {"array": array.tolist(), "dtype": str(array.dtype)}


def array_of(value: Any) -> Any:
    """Return an argument from its JSON: an array, a type of arrays, or the value as it is."""
    if not isinstance(value, Mapping) or "dtype" not in value or value.keys() - {"array", "dtype"}:
        return value
    dtype = np.dtype(str(value["dtype"]))
    return np.array(value["array"], dtype=dtype)[()] if "array" in value else dtype.type


def attribute_of(env: Any, name: str) -> Any:
    """Return an attribute of the first environment of an algorithm, through its wrappers; None without one."""
    try:
        return env.get_attr(name)[0]
    except (AttributeError, EOFError):  # the latter of another process
        return None


def _wrapper(spec: Any, env: Any) -> WrapperRecord:
    kwargs = spec.kwargs
    if kwargs is None and len(signature(pkgutil.resolve_name(spec.entry_point)).parameters) == 1:
        kwargs = {}  # the environment alone
    name = _entry_point(spec.entry_point)
    if (kwargs := _as_json(kwargs)) is None:
        warnings.warn(
            f"{name} does not tell its arguments (gymnasium.utils.RecordConstructorArgs): `evaluate` will ask for them "
            "with --wrappers",
            stacklevel=5,  # who saves the checkpoint
        )
    counted = attribute_of(env, "obs_rms") if spec.name == "NormalizeObservation" else None
    return WrapperRecord(name, kwargs, _statistics(counted))


def _entry_point(name: str) -> str:
    """Return `module:Class` of a wrapper; of one of the program that runs, by its file's name."""
    program = getattr(sys.modules["__main__"], "__file__", None)
    return name.replace("__main__:", f"{Path(program).stem}:") if program else name


def vec_wrapper(env: Any) -> _Wrappers:
    """Return the record of a wrapper of Stable-Baselines3; none for None, or for what changes nothing for a policy."""
    kind = type(env)
    if env is None or kind.__name__ in _IDLE or not vars(env).get("norm_obs", True):
        return ()
    own = vars(env) | vars(vars(env).get("stacked_obs", env))
    names = [name for name in signature(kind).parameters if name != "venv"]
    kwargs: Fields | None = {name: own[name] for name in names if name in own}
    if len(kwargs or {}) < len(names) and not kind.__module__.startswith("stable_baselines3."):
        kwargs = None  # kept under other names: unknown
    name = _entry_point(f"{kind.__module__}:{kind.__name__}")
    return (WrapperRecord(name, _as_json(kwargs), _statistics(own.get("obs_rms"))),)


def _statistics(counted: Any) -> Fields:
    by_key = counted if isinstance(counted, dict) else {"": counted} if counted else {}
    return {key: {"mean": own.mean, "var": own.var} for key, own in by_key.items()}
