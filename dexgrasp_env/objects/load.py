"""Objects by name or by path."""

import difflib
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np

from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand, printable_stem
from dexgrasp_env.objects.catalogue import (
    CATALOGUE,
    OBJECT_SETS,
    catalogue_object,
    varied_object,
    varied_targets,
)
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.sets import (
    MESH_SUFFIXES,
    is_set,
    mesh_file,
    set_member,
    set_targets,
)
from dexgrasp_env.valid import NAMED, Mass, Positive, Rule, check, checked, read


@checked
def load_object(
    target: str | os.PathLike[str], *, scale: Positive = 1.0, mass: Mass | None = None
) -> ObjectModel:
    """Return an object of the catalogue, or a user's mesh made fit for use.

    Args:
        target: a name of the catalogue, `varied-N`, the path of a mesh file, or `FILE.json#name` of a
            set file, whose scale and mass then hold.
        scale: factor from the file's unit to metres (0.001 for millimetres), or from the catalogue's size.
        mass: kilograms, in place of the object's own.

    Raises:
        InputError: for an unknown name, a file that cannot be used, a scale or a mass that is not positive.
    """
    target = str(check("object", target, NAMED))
    if is_ours(target):
        model = (catalogue_object if target in CATALOGUE else varied_object)(target).scaled(scale)
        return model if mass is None else model.with_mass(mass)
    if is_set(target):
        member = set_member(target)
        model = load_object(member.mesh, scale=member.scale, mass=member.mass)
        upright = None if member.upright is None else np.array(member.upright)
        return replace(model, name=member.name, friction=member.friction, upright=upright)
    path = Path(os.path.realpath(_bare_mesh(target)))
    return _mesh_object(path, path.stat().st_mtime_ns, scale, mass)


def is_ours(target: str) -> bool:
    """Return True for an object of the catalogue, or `varied-N`."""
    return target in CATALOGUE or varied_targets(target) == (target,)


def _bare_mesh(target: str) -> Path:
    """Return the path of a mesh; raise an InputError for a name that is neither an object, nor a set, nor a file."""
    if Path(target).suffix or os.sep in target or os.path.isfile(os.path.expanduser(target)):
        return mesh_file(target)
    near = difflib.get_close_matches(target.lower(), [*CATALOGUE, *OBJECT_SETS], n=3, cutoff=0.55)
    hint = f"; did you mean {' or '.join(near)}?" if near else ""
    raise InputError(
        f"unknown object {target!r}{hint} (objects: {', '.join(CATALOGUE)}; sets: {', '.join(OBJECT_SETS)}; "
        f"or a mesh file: {', '.join(MESH_SUFFIXES)}; or a set file: .json)"
    )


def load_target(target: str, mesh_scale: float = 1.0, mesh_mass: float | None = None) -> ObjectModel:
    """Return an object as `load_object` does; scale and mass apply to bare mesh files alone."""
    if has_own_size(target):
        return load_object(target)
    return load_object(target, scale=mesh_scale, mass=mesh_mass)


def has_own_size(target: str) -> bool:
    """Return True for a target of the catalogue, `varied-N` or a set file: all but bare mesh files."""
    return is_ours(target) or is_set(target)


def resolve_targets(targets: Sequence[str]) -> list[str]:
    """Expand the names of sets; names and paths stay as they are, each once, in the order given.

    Raises:
        InputError: for an unknown name or a missing file, listing what is valid.
    """
    names = [name for target in targets for name in _expanded(target)]
    if not names:
        raise InputError(f"no objects given: name some, or a set: {', '.join(OBJECT_SETS)}")
    for name in names:
        if not has_own_size(name):
            _bare_mesh(name)
    return list(dict.fromkeys(names))


def _resolved(value: Any) -> tuple[str, ...]:
    # Sets have no order that is the same tomorrow, iterators are read once.
    if isinstance(value, set | frozenset | Iterator):
        raise TypeError
    given = [value] if isinstance(value, str | os.PathLike) else value
    return tuple(resolve_targets([NAMED.validate(name) for name in given]))


Objects = Annotated[tuple[str, ...], Rule("a name, or a list of names", _resolved)]
"""Names and paths of objects, sets expanded: the field of settings."""


class OfObjects:
    """Base of settings that have `objects`."""

    @classmethod
    def of(cls, objects: Sequence[str], **rest: Any) -> Self:
        """Expand sets of objects and validate the settings; nothing is built.

        Raises:
            InputError: for an unknown object or name, or a number out of range.
        """
        return read(cls, {"objects": objects, **rest})


def _expanded(target: str) -> Sequence[str]:
    if not is_set(target):
        return OBJECT_SETS.get(target) or varied_targets(target) or (target,)
    if "#" in target:
        set_member(target)
        return (target,)
    return set_targets(target)


def target_files(target: str) -> tuple[Path, ...]:
    """Return the files that an object is made from: none, a mesh, or a set file and the member's mesh."""
    if is_ours(target):
        return ()
    if is_set(target):
        return expand(target.partition("#")[0]), set_member(target).mesh
    return (expand(target),)


def seed_name(target: str) -> str:
    """Return what an object's trials are drawn from: its name, of a mesh the name of its file."""
    return target.partition("#")[2] if is_set(target) else Path(target).name


def object_name(target: str) -> str:
    """Return the name an object is shown by: itself, the stem of a mesh file, or a member's of a set file."""
    return seed_name(target) if is_ours(target) or is_set(target) else printable_stem(Path(target))


@lru_cache(maxsize=64)
def _mesh_object(path: Path, stamp: int, scale: float, mass: float | None) -> ObjectModel:
    """Load a mesh once for each state of the file (`stamp`)."""
    from dexgrasp_env.objects.user_mesh import load_mesh

    return load_mesh(path, scale=scale, mass=mass)
