"""Values of a file: numbers of a shape, words, convex parts. What is none of these is a ValueError that says so."""

from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array

_LARGEST = 1e6  # in SI units: no number of a grasp is nearly as large, and squares of larger ones overflow
_FLAT = 1e-6  # m: a part thinner than this has no inside
_MOST_VERTICES, _MOST_PARTS = 100_000, 64


def array(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return finite numbers of a shape; text and truth values are no numbers."""
    try:
        found = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be numbers of shape {shape}") from None
    if found.shape != shape or _has_words(value):
        raise ValueError(f"{name} must be numbers of shape {shape}, not {found.shape}")
    if not (np.abs(found) < _LARGEST).all():
        raise ValueError(f"{name} must be finite numbers below {_LARGEST:.0e}")
    return found


def number(name: str, value: Any) -> float:
    """Return a finite number."""
    return float(array(name, value, ()))


def positive(name: str, value: Any) -> float:
    """Return a finite number above 0."""
    found = number(name, value)
    if found <= 0.0:
        raise ValueError(f"{name} must be above 0, not {found}")
    return found


def word(name: str, value: Any) -> str:
    """Return a text of some length."""
    if not isinstance(value, str) or len(value) > 4096:
        raise ValueError(f"{name} must be a word")
    return value


def items(name: str, value: Any, least: int, most: int) -> list[Any]:
    """Return a list of `least` to `most` items."""
    if not isinstance(value, list) or not least <= len(value) <= most:
        raise ValueError(f"{name} must be a list of {least} to {most} items")
    return value


def convex_parts(name: str, value: Any) -> tuple[Array, ...]:
    """Return the vertices (V, 3) m of convex parts, each of which encloses a volume."""
    return tuple(_hull(name, part) for part in items(name, value, 1, _MOST_PARTS))


def _hull(name: str, value: Any) -> Array:
    hull = array(name, value, (len(items(f"a part of {name}", value, 4, _MOST_VERTICES)), 3))
    if np.linalg.svd(hull - hull.mean(0), compute_uv=False)[2] < _FLAT:
        raise ValueError(f"every part of {name} must enclose a volume")
    return hull


def _has_words(value: Any) -> bool:
    if isinstance(value, list):
        return any(_has_words(item) for item in value)
    return isinstance(value, str | bool)
