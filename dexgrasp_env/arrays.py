"""The types of this project: arrays in metres, radians and whatever shape the docstring says, and values by name."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dexgrasp_env.valid import Rule

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Single = NDArray[np.float32]
AnyArray = NDArray[Any]
Arrays = dict[str, AnyArray]
Fields = dict[str, Any]
"""By name: a row of a table, an object of JSON, an `info`."""
LARGEST = 1e6
"""In SI units: no number that somebody states is nearly as large, and squares of larger ones overflow."""


def array(*shape: int | None) -> Rule:
    """Return the rule of finite numbers of a shape (None: any length); text and truth values are no numbers."""
    sizes = ", ".join("N" if size is None else str(size) for size in shape)

    def validate(value: Any) -> Array:
        """Return the array that a value states."""
        found = np.array(value, dtype=np.float64, order="C")
        if not _fits(found, shape) or _has_words(value) or not (np.abs(found) < LARGEST).all():
            raise ValueError
        return found

    return Rule(f"finite numbers below {LARGEST:.0e} of shape ({sizes})", validate)


def numbers(words: str, *shape: int | None) -> Rule:
    """Return the rule of arrays of numbers of any kind, of a shape (None: any length) where it is given."""

    def validate(value: Any) -> AnyArray:
        """Return the array."""
        found = np.asarray(value)
        if found.dtype.kind not in "biuf" or (shape and not _fits(found, shape)):
            raise ValueError
        return found

    return Rule(words, validate)


def _fits(found: AnyArray, shape: Sequence[int | None]) -> bool:
    sizes = zip(shape, found.shape, strict=False)
    return found.ndim == len(shape) and all(size in (None, own) for size, own in sizes)


def _has_words(value: Any) -> bool:
    if isinstance(value, list):
        return any(map(_has_words, value))
    return isinstance(value, str | bool)


def fibonacci_directions(count: int) -> Array:
    """Return (count, 3) unit vectors spread evenly over the sphere, always the same."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * index
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=-1)


def unit(vectors: Array) -> Array:
    """Return vectors (..., n) at length 1; those without a length stay about 0."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def middle(points: Array) -> Array:
    """Return the middle (n,) of the box around points (N, n)."""
    return 0.5 * (points.min(0) + points.max(0))


def grid(*axes: ArrayLike) -> Array:
    """Return the points (N, n) whose coordinates are those of n axes, the last axis running fastest."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(axes))


def box_corners(low: ArrayLike, high: ArrayLike) -> Array:
    """Return the corners (8, 3) of a box between its lowest and its highest (3,)."""
    return np.array(np.meshgrid(*np.transpose([low, high]))).reshape(3, 8).T


def cube_directions() -> Array:
    """Return the 26 unit directions (26, 3) to the faces, edges and corners of a cube."""
    points = grid(*[[-1.0, 0.0, 1.0]] * 3)
    return unit(points[points.any(1)])


def joined(clouds: Sequence[Array]) -> Arrays:
    """Return the `points` (n, 3) of several clouds as one array, and the `counts` that each has."""
    counts = np.array([len(cloud) for cloud in clouds], dtype=np.int64)
    return {"points": np.concatenate([np.zeros((0, 3)), *clouds]), "counts": counts}


def divided(points: Array, counts: Index) -> list[Array]:
    """Return the clouds that `joined` was given."""
    return np.split(points, np.cumsum(counts)[:-1])
