"""Set files: meshes of one's own with name, scale, mass, friction and upright pose each, as JSON.

    {"schema": 1, "objects": [
        {"name": "mug", "mesh": "mug.obj", "scale": 0.001, "mass": 0.118, "friction": 0.5,
         "upright": [1, 0, 0, 0], "source": "where it is from"}]}

Only `name` and `mesh` (relative to the file) are needed. A member is addressed as `FILE.json#name`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand, parse_json
from dexgrasp_env.objects.catalogue import CATALOGUE, OBJECT_SETS

SCHEMA = 1
MASS_LIMITS = (1e-4, 100.0)
"""kg: lighter bodies vanish in the solver's tolerance, heavier ones are no objects for a hand."""
_MOST_FRICTION = 2.0
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,100}")


@dataclass(frozen=True)
class SetMember:
    """One object of a set file.

    Attributes:
        name: what it is called in results; trials of the same name meet the same scenes.
        mesh: an obj, stl, ply or glb file.
        scale: factor from its unit to metres.
        mass: kg; None: by its volume.
        friction: sliding coefficient where the environment names none; None: the environment's own default.
        upright: wxyz of the pose it is presented upright in; None: as built, z up.
        source: where it is from, for people.
    """

    name: str
    mesh: Path
    scale: float = 1.0
    mass: float | None = None
    friction: float | None = None
    upright: tuple[float, float, float, float] | None = None
    source: str = ""


def is_set(target: str) -> bool:
    """Whether a target is meant as a set file or as a member of one."""
    return target.partition("#")[0].lower().endswith(".json")


def set_targets(path: str) -> list[str]:
    """Return the targets of all members of a set file, which is checked as a whole.

    Raises:
        InputError: one line: a file that is missing or wrong, and where.
    """
    return [f"{path}#{name}" for name in read_set(path)]


def set_member(target: str) -> SetMember:
    """Return the member that `FILE.json#name` names.

    Raises:
        InputError: for a wrong file, or no such member.
    """
    path, _, name = target.partition("#")
    members = read_set(path)
    if name not in members:
        raise InputError(f"set file {path!r} has no object {name!r}: valid are {', '.join(members)}")
    return members[name]


def read_set(path: str) -> dict[str, SetMember]:
    """Return the members of a set file by name.

    Raises:
        InputError: one line: a file that is missing or wrong, and where.
    """
    file = expand(path)
    try:
        content = parse_json(file.read_bytes())
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"set file {path!r} cannot be read ({reason}): it must be JSON") from None
    entries = content.get("objects") if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries or content.get("schema") != SCHEMA:
        raise InputError(f'set file {path!r} must hold {{"schema": {SCHEMA}, "objects": [...]}}')
    members: dict[str, SetMember] = {}
    for number, entry in enumerate(entries, start=1):
        try:
            member = _member(entry, file.parent, members)
        except InputError as error:
            raise InputError(f"set file {path!r}, object {number}: {error}") from None
        members[member.name] = member
    return members


def _member(entry: Any, folder: Path, before: Mapping[str, SetMember]) -> SetMember:
    if not isinstance(entry, dict):
        raise InputError('it must be like {"name": "mug", "mesh": "mug.obj"}')
    fields = SetMember.__dataclass_fields__
    for key in entry:
        if key not in fields:
            raise InputError(f"unknown key {key!r}: valid are {', '.join(fields)}")
    name = entry.get("name")
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise InputError(f"name is {name!r}: it must be letters, digits, '_', '-' and '.'")
    if name in before or name in CATALOGUE or name in OBJECT_SETS:
        raise InputError(f"name {name!r} is taken by another object or set: choose another")
    upright = entry.get("upright")
    return SetMember(
        name, _mesh(entry.get("mesh"), folder), _number(entry, "scale", (1e-6, 1e6), 1.0) or 1.0,
        _number(entry, "mass", MASS_LIMITS), _number(entry, "friction", (0.01, _MOST_FRICTION)),
        None if upright is None else _quaternion(upright), str(entry.get("source", "")),
    )  # fmt: skip


def _mesh(value: Any, folder: Path) -> Path:
    if not isinstance(value, str) or not value:
        raise InputError(f"mesh is {value!r}: it must be the path of a mesh, from the set file on")
    path = folder / expand(value)
    if not os.path.isfile(path):
        raise InputError(f"mesh file {str(path)!r} does not exist")
    return path


def _number(
    entry: Mapping[str, Any], key: str, bounds: tuple[float, float], default: float | None = None
) -> float | None:
    value = entry.get(key, default)
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, int | float) or not bounds[0] <= value <= bounds[1]:
        raise InputError(f"{key} is {value!r}: valid are numbers from {bounds[0]:g} to {bounds[1]:g}")
    return float(value)


def _quaternion(value: Any) -> tuple[float, float, float, float]:
    numbers = isinstance(value, list) and all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in value
    )
    if not numbers or len(value) != 4 or abs(np.linalg.norm(value) - 1.0) > 1e-3:
        raise InputError(f"upright is {value!r}: it must be a unit quaternion w, x, y, z, or null")
    w, x, y, z = (np.asarray(value, dtype=float) / np.linalg.norm(value)).tolist()
    return (w, x, y, z)
