"""Demonstrations in the layout of robomimic's data sets: one HDF5 file, a group an episode."""

import json
import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from dexgrasp.data.demonstrations.rollout import Episode
from dexgrasp.data.demonstrations.settings import ENV_ID, DemoSettings
from dexgrasp_env import __version__
from dexgrasp_env.arrays import Arrays
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import jsonable

FILE = "robomimic/demos.hdf5"


def write_robomimic(folder: Path, settings: DemoSettings, episodes: Iterable[Episode]) -> None:
    """Write `folder/robomimic/demos.hdf5`, in place of what is there.

    Below `data/demo_K` are `actions`, `rewards`, `dones`, and `obs` and `next_obs` by key, pictures as `view_K_image`
    (T, H, W, 3); in the attribute `about` are object, seeds and certificate, as JSON. There are no `states`: scenes
    are made again from their seeds.
    """
    with from_extra():
        import h5py

    making = (folder / FILE).with_suffix(".part")
    shutil.rmtree(making.parent, ignore_errors=True)
    making.parent.mkdir(parents=True)
    total, names = 0, list[str]()
    with h5py.File(making, "w") as file:
        data = file.create_group("data")
        for number, episode in enumerate(episodes):
            names.append(f"demo_{number}")
            group, count, seen = data.create_group(names[-1]), len(episode), _seen(episode)
            group.attrs.update(num_samples=count, about=json.dumps(episode.about))
            parts: Arrays = {"actions": episode.actions, "rewards": episode.rewards}
            parts["dones"] = (np.arange(count) == count - 1).astype(np.int64)
            parts |= {f"obs/{key}": array[:-1] for key, array in seen.items()}
            parts |= {f"next_obs/{key}": array[1:] for key, array in seen.items()}
            for name, array in parts.items():
                group.create_dataset(name, data=array, compression="gzip" if array.ndim > 2 else None)
            total += count
        kwargs = jsonable(settings.env_arguments) | {"objects": list(settings.objects)}
        gym_type = 2  # of robomimic's `EnvType`
        about = {"env_name": ENV_ID, "env_version": __version__, "type": gym_type, "env_kwargs": kwargs}
        data.attrs.update(total=total, env_args=json.dumps(about))
        valid = names[9::10]
        masks = {"train": [name for name in names if name not in valid], "valid": valid}
        for mask, chosen in masks.items():
            file.create_dataset(f"mask/{mask}", data=np.array(chosen, dtype="S"))
    making.rename(folder / FILE)


def _seen(episode: Episode) -> Arrays:
    """Return the observations (T + 1, ...) by key; what was seen once is there at every step."""
    steps = len(episode) + 1
    seen = episode.observations | {
        key: np.broadcast_to(array, (steps, *array.shape)) for key, array in episode.once.items()
    }
    pictures = seen.pop("rgb", np.zeros((steps, 0)))
    return seen | {f"view_{k}_image": pictures[:, k] for k in range(pictures.shape[1])}
