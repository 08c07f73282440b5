"""A line of trials.jsonl: what it must hold to be counted, and what its files are called."""

import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Natural, Rule, number, read

Key = tuple[str, str, str, int]
"""Protocol, agent, object, trial."""

_UNITS = ("_percent", "_margin", "_m", "_rad", "_fraction")
_Seed = Annotated[int, number(ge=0, lt=2**32, whole=True)]


def _are_numbers(values: Iterable[Any]) -> None:
    for value in values:
        if value is not None:
            number().admit(value)


def _stages(value: Any) -> None:
    _are_numbers(value.values())


def _certificate(value: Any) -> None:
    _are_numbers(value.get("distances_cm") or ())
    _are_numbers(each for name, each in value.items() if name.endswith(_UNITS))


_Stages = Annotated[dict[str, Any] | None, Rule("numbers by stage", _stages)]


@dataclass(frozen=True)
class _Details:
    """What summaries read of an agent's report; the rest is the agent's own."""

    stage_seconds: _Stages = None
    stage_repeats: _Stages = None
    certificate: Annotated[dict[str, Any] | None, Rule("an object of numbers", _certificate)] = None


@dataclass(frozen=True)
class _Row:
    agent: str
    object: str
    trial: Natural
    success: bool
    stable: bool
    reason: str | None
    planning_seconds: float | None
    details: _Details
    protocol: str = ""
    scene_seed: _Seed = 0
    agent_seed: _Seed = 0
    error: str | None = None
    grasp: str = ""
    env: dict[str, Any] = field(default_factory=dict)
    stage: str = ""
    steps: int = 0
    warnings: list[str] = field(default_factory=list)
    height: float | None = None
    slip: float | None = None
    tilt: float | None = None
    clean: bool | None = None
    moved: float | None = None
    hit: int | None = None
    hit_names: list[str] = field(default_factory=list)
    total_reward: float | None = None
    seconds: float | None = None


def row_fault(row: object) -> str | None:
    """Return what is wrong with a line as it was parsed, or None; other keys than these are left alone."""
    try:
        read(_Row, row, more=True)
    except InputError as error:
        return str(error)
    return None


def fell_short(row: Mapping[str, Any]) -> bool:
    """Whether a trial failed, or lifted the object and moved what stood around it."""
    return not row["success"] or row.get("clean") is False


def row_key(row: Mapping[str, Any]) -> Key:
    """Return what tells a trial from the others of its evaluation."""
    return row.get("protocol") or "", row["agent"], row["object"], row["trial"]


def trial_name(row: Mapping[str, Any]) -> str:
    """Return the stem of the files of a trial: its protocol, agent, object and number, as any file system takes it."""
    whole = "-".join([*filter(None, [row.get("protocol")]), row["agent"], row["object"], str(row["trial"])])
    plain = re.sub(r"[^\w.@+-]", ".", whole)
    if plain == whole and len(plain) <= 120:
        return plain
    return f"{plain[-100:]}-{hashlib.sha256(whole.encode(errors='replace')).hexdigest()[:6]}"
