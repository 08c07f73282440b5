"""Types of the fields of a grasp file, each with the rule of `dexgrasp_env.valid` that it is held to."""

from typing import Annotated, Any

import numpy as np

from dexgrasp_env.arrays import LARGEST, Array, array
from dexgrasp_env.robot.table import points_between
from dexgrasp_env.valid import Rule, number

_MOST_PARTS = 64


def _corners(value: Any) -> Array:
    part: Array = points_between(4, 100_000).validate(value)
    # m: a part thinner than this has no inside
    if np.linalg.svd(part - part.mean(0), compute_uv=False)[2] < 1e-6:
        raise ValueError
    return part


def _convex_parts(value: Any) -> tuple[Array, ...]:
    if not isinstance(value, list) or not 1 <= len(value) <= _MOST_PARTS:
        raise ValueError
    return tuple(map(_corners, value))


def _word(value: Any) -> str:
    if not isinstance(value, str) or len(value) > 4096:
        raise ValueError
    return value


Number = Annotated[float, number(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, number(gt=0, le=LARGEST)]
Share = Annotated[float, number(ge=0, le=1)]
Word = Annotated[str, Rule("a word", _word)]
Vector = Annotated[Array, array(3)]
Row = Annotated[Array, array(None)]
Pose = Annotated[Array, array(4, 4)]
Numbers = tuple[Number, ...]
CORNERS = Rule("4 or more corners (x, y, z) around a volume", _corners)
Parts = Annotated[
    tuple[Array, ...],
    Rule(f"1 to {_MOST_PARTS} lists of 4 or more corners (x, y, z), each around a volume", _convex_parts),
]
