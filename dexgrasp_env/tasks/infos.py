"""Infos of many environments: arrays by key, with Gymnasium's masks."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Fields, Mask


def objects(values: list[Any]) -> NDArray[Any]:
    """Return an array of objects, (N,)."""
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array


def with_masks(infos: Fields) -> Fields:
    """Add Gymnasium's masks: every environment has every key."""
    number = len(next(value for value in infos.values() if not isinstance(value, dict)))
    return {**infos, **{f"_{key}": np.ones(number, bool) for key in infos}}


def masked(infos: Fields, mask: Mask) -> Fields:
    """Return the infos of a part of the environments, as Gymnasium has them: nothing and False for the others."""
    kept: Fields = {}
    for key, value in infos.items():
        if isinstance(value, dict):
            kept[key] = masked(value, mask)
        else:
            kept[key] = value.copy()
            kept[key][~mask] = None if value.dtype == object else 0
    return kept
