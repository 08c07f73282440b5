"""Arithmetic on plain numbers and on arrays alike.

One environment's state comes apart into plain numbers (`poses.components`), which Python adds and multiplies many times
faster than NumPy does arrays of one; that of many comes apart into arrays. The same formulas serve both, and since
+ - * / and the square root are correctly rounded in both, they give the same bits.
"""

import math
from typing import Any

import numpy as np


def least(a: Any, b: Any) -> Any:
    """Return the smaller one."""
    return (a if a < b else b) if isinstance(a, float | int) else np.minimum(a, b)


def most(a: Any, b: Any) -> Any:
    """Return the larger one."""
    return (a if a > b else b) if isinstance(a, float | int) else np.maximum(a, b)


def root(a: Any) -> Any:
    """Return the square root."""
    return math.sqrt(a) if isinstance(a, float) else np.sqrt(a)


def some(a: Any) -> bool:
    """Return whether any is true."""
    return a if isinstance(a, bool) else bool(a.any())


def choose(condition: Any, a: Any, b: Any) -> Any:
    """Return `a` where the condition holds, else `b`."""
    return (a if condition else b) if isinstance(condition, bool) else np.where(condition, a, b)


def excess(a: Any) -> Any:
    """Return `a` where it is positive, else 0: exactly, since doubling and halving do not round."""
    return 0.5 * (a + abs(a))
