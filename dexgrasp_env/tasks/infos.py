"""Infos of many environments: arrays by key, with Gymnasium's masks."""

import numpy as np

from dexgrasp_env.arrays import Fields, Mask


def with_masks(infos: Fields, number: int) -> Fields:
    """Add Gymnasium's masks: every environment of so many has every key."""
    values = {k: with_masks(v, number) if isinstance(v, dict) else v for k, v in infos.items()}
    return values | {f"_{key}": np.ones(number, bool) for key in infos}


def of_one(infos: Fields, i: int) -> Fields:
    """Return the infos of environment `i` alone, without masks and without those of an episode that has ended."""
    return {
        key: of_one(value, i) if isinstance(value, dict) else value[i]
        for key, value in infos.items()
        if not key.startswith("_") and key not in ("final_obs", "final_info")
    }


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
