"""A line of trials.jsonl: what it must hold to be counted, and what its files are called."""

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, Any

from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Natural, Rule, number, read

Key = tuple[str, str, str, int]
"""Protocol, agent, object, trial."""

_UNITS = ("_percent", "_margin", "_m", "_rad", "_fraction")
_Seed = Annotated[int, number(ge=0, lt=2**32, whole=True)]


@dataclass
class Outcome:
    """How a trial went.

    Attributes:
        success: held at height by the hand alone for 3 s.
        stable: little motion in the hand at the end.
        reason: why it failed, one of a countable few; None for successes.
        stage: how far the object came.
        steps: control steps taken.
        total_reward: sum of the rewards of these, undiscounted.
        height: of the object's lowest point at the end, m.
        slip: in the hand since it left the table, m.
        tilt: in the hand since it left the table, rad.
        clean: a success that moved no neighbour by more than 2 cm; None where there are none.
        moved: the farthest that a neighbour's centre has been from where it would be without the robot, m.
        hit: neighbours that the robot has touched.
        hit_names: theirs.
        planning_seconds: as the agent reports; None if it does not plan.
        seconds: wall time of the trial.
        warnings: of the physics engine.
        details: of the agent's report.
        error: the traceback of an agent's exception, or what was wrong with its action.
    """

    success: bool = False
    stable: bool = False
    reason: str | None = None
    stage: str = "untouched"
    steps: int = 0
    total_reward: float | None = 0.0
    height: float | None = 0.0
    slip: float | None = 0.0
    tilt: float | None = 0.0
    clean: bool | None = None
    moved: float | None = None
    hit: int | None = None
    hit_names: list[str] = field(default_factory=list)
    planning_seconds: float | None = None
    seconds: float = 0.0
    warnings: list[str] = field(default_factory=list)
    details: Fields = field(default_factory=dict)
    error: str | None = None


def _are_numbers(values: Iterable[Any]) -> None:
    for value in values:
        if value is not None:
            number().admit(value)


def _certificate(value: Any) -> None:
    _are_numbers(value.get("distances_cm") or ())
    _are_numbers(each for name, each in value.items() if name.endswith(_UNITS))


_Stages = Annotated[Fields | None, Rule("numbers by stage", lambda value: _are_numbers(value.values()))]


@dataclass(frozen=True)
class _Details:
    """What summaries read of an agent's report; the rest is the agent's own."""

    stage_seconds: _Stages = None
    stage_repeats: _Stages = None
    certificate: Annotated[Fields | None, Rule("an object of numbers", _certificate)] = None


@dataclass(kw_only=True)
class _Row(Outcome):
    """What must be there, beside an outcome."""

    protocol: str
    agent: str
    object: str
    trial: Natural
    scene_seed: _Seed
    agent_seed: _Seed
    success: bool = field()
    stable: bool = field()
    reason: str | None = field()
    planning_seconds: float | None = field()
    details: _Details = field()  # type: ignore[assignment]
    env: Fields = field(default_factory=dict)
    grasp: str = ""


def row_fault(row: object) -> str | None:
    """Return what is wrong with a line as it was parsed, or None; other keys than these are left alone."""
    try:
        read(_Row, row, more=True)
    except InputError as error:
        return str(error)
    return None


def fell_short(row: Fields) -> bool:
    """Whether a trial failed, or lifted the object and moved what stood around it."""
    return not row["success"] or row.get("clean") is False


def row_key(row: Fields) -> Key:
    """Return what tells a trial from the others of its evaluation."""
    return row["protocol"], row["agent"], row["object"], row["trial"]


def trial_name(row: Fields) -> str:
    """Return the stem of the files of a trial: its protocol, agent, object and number, as any file system takes it."""
    whole = "-".join(map(str, row_key(row)))
    plain = re.sub(r"[^\w.@+-]", ".", whole)
    if plain == whole and len(plain) <= 120:
        return plain
    return f"{plain[-100:]}-{hashlib.sha256(whole.encode(errors='replace')).hexdigest()[:6]}"
