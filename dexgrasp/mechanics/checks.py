"""Checks of contacts that a user states; what the library has computed itself is not checked again."""

from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array, array
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import POSITIVE, check

Numbers = Any
"""Whatever numpy turns into numbers: public functions take it and check it."""


def check_array(name: str, value: object, shape: tuple[int | None, ...]) -> Array:
    """Return `value` as a contiguous float array of `shape` (None: any length), or raise `InputError`."""
    return check(name, value, array(*shape))


def check_positive(name: str, value: Any) -> float:
    """Return `value` as a float above zero, or raise `InputError`."""
    return check(name, value, POSITIVE)


def check_contacts(points: object, normals: object) -> tuple[Array, Array]:
    """Return points and unit normals, both (N, 3), after checking shapes, finiteness and unit length."""
    points = check_array("points", points, (None, 3))
    normals = check_array("normals", normals, (len(points), 3))
    check_unit(normals)
    return points, normals


def check_unit(normals: Array) -> None:
    """Raise `InputError` where a normal's length differs from 1 by more than 1e-6."""
    length = np.sqrt((normals**2).sum(-1))
    if length.size and np.abs(length - 1.0).max() > 1e-6:
        worst = length.flat[np.abs(length - 1.0).argmax()]
        raise InputError(f"normals must have unit length within 1e-6, one has {worst:.6g}")
