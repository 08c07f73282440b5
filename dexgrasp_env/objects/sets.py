"""Set files: meshes of one's own with name, scale, mass, friction and upright pose each, as JSON.

    {"schema": 1, "objects": [
        {"name": "mug", "mesh": "mug.obj", "scale": 0.001, "mass": 0.118, "friction": 0.5,
         "upright": [1, 0, 0, 0], "source": "where it is from"}]}

Only `name` and `mesh` (relative to the file) are needed. A member is addressed as `FILE.json#name`.
"""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand, read_json_object
from dexgrasp_env.objects.catalogue import CATALOGUE, OBJECT_SETS
from dexgrasp_env.valid import Mass, Rule, number, read, several

SCHEMA = 1
MESH_SUFFIXES = (".obj", ".stl", ".ply", ".glb", ".gltf", ".off", ".dae", ".3mf")


def _quaternion(value: Any) -> tuple[float, float, float, float]:
    w, x, y, z = several(number(), 4).validate(value)
    norm = float(np.linalg.norm([w, x, y, z]))
    if abs(norm - 1.0) > 1e-3:
        raise ValueError
    return (w / norm, x / norm, y / norm, z / norm)


def _name(value: Any) -> str:
    if not re.fullmatch(r"[A-Za-z0-9_.-]{1,100}", value):
        raise ValueError
    return str(value)


@dataclass(frozen=True)
class SetMember:
    """One object of a set file.

    Attributes:
        name: what it is called in results; trials of the same name meet the same scenes.
        mesh: a file of `MESH_SUFFIXES`.
        scale: factor from its unit to metres.
        mass: kg; None: by its volume.
        friction: sliding coefficient where the environment names none; None: the environment's own default.
        upright: wxyz of the pose it is presented upright in; None: as built, z up.
        source: where it is from, for people.
    """

    name: Annotated[str, Rule("letters, digits, '_', '-' and '.'", _name)]
    mesh: Annotated[Path, Rule("the path of a mesh, from the set file on", expand)]
    scale: Annotated[float, number(ge=1e-6, le=1e6)] = 1.0
    mass: Mass | None = None
    friction: Annotated[float | None, number(ge=0.01, le=2)] = None
    upright: Annotated[
        tuple[float, float, float, float] | None, Rule("a unit quaternion w, x, y, z, or null", _quaternion)
    ] = None
    source: str = ""


def is_set(target: str) -> bool:
    """Return True for a target that means a set file or a member of one."""
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
    content = read_json_object(file, "a set file is JSON", f"set file {path!r} cannot be read")
    entries = content.get("objects")
    if not isinstance(entries, list) or not entries or content.get("schema") != SCHEMA:
        raise InputError(f'set file {path!r} must hold {{"schema": {SCHEMA}, "objects": [...]}}')
    members: dict[str, SetMember] = {}
    for k, entry in enumerate(entries, start=1):
        try:
            member = _member(entry, file.parent, members)
        except InputError as error:
            raise InputError(f"set file {path!r}, object {k}: {error}") from None
        members[member.name] = member
    return members


def _member(entry: Any, folder: Path, before: Mapping[str, SetMember]) -> SetMember:
    if isinstance(entry, dict):
        entry = {key: value for key, value in entry.items() if value is not None}
    member = read(SetMember, entry)
    if member.name in {*before, *CATALOGUE, *OBJECT_SETS}:
        raise InputError(f"name {member.name!r} is taken by another object or set: choose another")
    return replace(member, mesh=mesh_file(folder / member.mesh))


def mesh_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a mesh file with its `~` expanded.

    Raises:
        InputError: if there is no such file.
    """
    found = expand(path)
    if not os.path.isfile(found):  # unlike Path.is_file it takes names of any length
        raise InputError(
            f"mesh file {str(path)!r} does not exist: give the path of one ({', '.join(MESH_SUFFIXES)})"
        )
    return found
