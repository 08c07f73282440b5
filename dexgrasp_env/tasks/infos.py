"""Infos of episodes: plain values of one, arrays by key of many, with Gymnasium's masks."""

from typing import TYPE_CHECKING, Any

import numpy as np

from dexgrasp_env.arrays import Fields, Mask
from dexgrasp_env.tasks.randomisation import Variation
from dexgrasp_env.tasks.records import INFO_NAMES, INFOS
from dexgrasp_env.tasks.settings import WEIGHTS
from dexgrasp_env.tasks.simulation import warning_names

if TYPE_CHECKING:
    from dexgrasp_env.tasks.episodes import Episodes


def info_of(episodes: "Episodes", i: int) -> Fields:
    """Return the info of episode `i` alone, plain values; `infos_of` one takes a tenth of a step."""
    columns: Fields = dict(zip(INFOS, episodes.info_fields[i].item(), strict=True))
    for key, names in INFO_NAMES.items():
        columns[key] = names[columns[key]]
    columns["held_seconds"] *= episodes.settings.period
    columns["object"] = episodes.object_name(i)
    columns["mujoco_warnings"] = warning_names(columns["mujoco_warnings"])
    columns["variation"] = dict(vars(episodes.slots[i].variation))
    columns["reward_terms"] = dict(zip(WEIGHTS, episodes.records["terms"][i].tolist(), strict=True))
    for key, values in episodes.more_infos().items():
        columns[key] = values[i : i + 1].tolist()[0]
    return columns


def infos_of(episodes: "Episodes") -> Fields:
    """Return the infos without cameras, arrays (N,) by key: the same at reset and at every step."""
    records = episodes.records
    infos: Fields = {key: records[field].copy() for key, field in INFOS.items()}
    for key, names in INFO_NAMES.items():
        infos[key] = np.array(names, object)[infos[key]]
    objects = [*map(episodes.object_name, range(len(records)))]
    warnings = [*map(warning_names, infos["mujoco_warnings"].tolist())]
    return infos | {
        "held_seconds": infos["held_seconds"] * episodes.settings.period,
        "object": np.array(objects, object),
        "mujoco_warnings": np.array(warnings, object),
        "variation": dict(zip(vars(Variation()), records["variation"].T.copy(), strict=True)),
        "reward_terms": dict(zip(WEIGHTS, records["terms"].T.copy(), strict=True)),
        **episodes.more_infos(),
    }


def with_masks(infos: Fields, number: int) -> Fields:
    """Add Gymnasium's masks: every environment of so many has every key."""
    values = {k: with_masks(v, number) if isinstance(v, dict) else v for k, v in infos.items()}
    masks = np.ones((len(infos), number), bool)
    return values | {f"_{key}": mask for key, mask in zip(infos, masks, strict=True)}


def of_one(values: Any, i: int) -> Any:
    """Return observation or infos of environment `i` alone, without masks and those of an episode that has ended."""
    if not isinstance(values, dict):
        return values[i]
    return {
        key: of_one(value, i)
        for key, value in values.items()
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
