"""Infos of episodes: plain values of one, arrays by key of many, with Gymnasium's masks."""

from collections.abc import Mapping, Sequence

import numpy as np

from dexgrasp_env.arrays import AnyArray, Arrays, Fields, Mask
from dexgrasp_env.tasks.randomisation import Variation
from dexgrasp_env.tasks.records import INFOS
from dexgrasp_env.tasks.settings import WEIGHTS, LiftSettings
from dexgrasp_env.tasks.simulation import Simulation, warning_names
from dexgrasp_env.tasks.slots import Slot, Starts
from dexgrasp_env.tasks.starts import ReverseStarts


class EpisodeInfos:
    """Infos of N episodes, from their records.

    Attributes:
        settings: of the environment.
        simulations: scenes by target.
        slots: of the episodes.
        records: (N,) of the episodes.
        info_fields: (N,) their fields of `INFOS`: a view.
        starts: where episodes begin, if not as usual.
    """

    settings: LiftSettings
    simulations: Mapping[str, Simulation]
    slots: Sequence[Slot]
    records: AnyArray
    info_fields: AnyArray
    starts: Starts | None
    _named = {key: names for key, (_, names) in INFOS.items() if names}  # noqa: RUF012  (never written to)

    def info(self, i: int) -> Fields:
        """Return the info of episode `i` alone, plain values; `infos` of one takes a tenth of a step."""
        columns: Fields = dict(zip(INFOS, self.info_fields[i].item(), strict=True))
        for key, names in self._named.items():
            columns[key] = names[columns[key]]
        columns["held_seconds"] *= self.settings.period
        slot = self.slots[i]
        columns["object"] = self.simulations[slot.target].object.name if slot.target else ""
        columns["mujoco_warnings"] = warning_names(columns["mujoco_warnings"])
        columns["variation"] = dict(vars(slot.variation))
        columns["reward_terms"] = dict(zip(WEIGHTS, self.records["terms"][i].tolist(), strict=True))
        for key, values in self.more_infos().items():
            columns[key] = values[i : i + 1].tolist()[0]
        return columns

    def infos(self) -> Fields:
        """Return the infos without cameras, arrays (N,) by key: the same at reset and at every step."""
        infos: Fields = {}
        for key, (field, names) in INFOS.items():
            values = self.records[field]
            infos[key] = np.array(names, object)[values] if names else values.copy()
        infos["held_seconds"] = infos["held_seconds"] * self.settings.period
        objects = [self.simulations[slot.target].object.name if slot.target else "" for slot in self.slots]
        warnings = [*map(warning_names, infos["mujoco_warnings"].tolist())]
        return infos | {
            "object": np.array(objects, object),
            "mujoco_warnings": np.array(warnings, object),
            "variation": dict(zip(vars(Variation()), self.records["variation"].T.copy(), strict=True)),
            "reward_terms": dict(zip(WEIGHTS, self.records["terms"].T.copy(), strict=True)),
            **self.more_infos(),
        }

    def more_infos(self) -> Arrays:
        """Return the task's own infos beside `INFOS`, arrays (N,) by key; `level` where starts move back."""
        if not isinstance(self.starts, ReverseStarts):
            return {}
        return {"level": np.full(len(self.slots), self.starts.front)}


def with_masks(infos: Fields, number: int) -> Fields:
    """Add Gymnasium's masks: every environment of so many has every key."""
    values = {k: with_masks(v, number) if isinstance(v, dict) else v for k, v in infos.items()}
    masks = np.ones((len(infos), number), bool)
    return values | {f"_{key}": mask for key, mask in zip(infos, masks, strict=True)}


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
