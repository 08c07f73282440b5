"""Demonstrations in HDF5: Minari data sets, written and read, and robomimic's format."""

import copy
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from dexgrasp.data.demonstrations.lerobot_format import views_of
from dexgrasp.data.demonstrations.rollout import Demonstration
from dexgrasp.data.demonstrations.settings import CAMERA_KEYS, ENV_ID, DemoSettings
from dexgrasp_env import __version__
from dexgrasp_env.arrays import Arrays
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra, require_extra
from dexgrasp_env.files import jsonable

DATA = "data"
_FILE = "main_data.hdf5"


def write_minari(folder: Path, settings: DemoSettings, episodes: Iterable[Demonstration]) -> None:
    """Write a Minari data set into a new folder.

    In the HDF5 file an episode has a group `once` with the observations of cameras at reset, and an attribute `about`,
    JSON with object, seeds and certificate.
    """
    require_extra("demos", "the Minari format")
    import gymnasium as gym
    import h5py
    import minari
    from minari.data_collector.episode_buffer import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    env = gym.make(ENV_ID, objects=[settings.objects[0]], **settings.env_arguments)
    assert env.spec  # as all that `gym.make` makes
    spec = copy.deepcopy(env.spec)
    spec.kwargs["objects"] = list(settings.objects)  # one is enough here, and quicker made
    once = CAMERA_KEYS if settings.observe == "reset" else ()
    seen: Any = env.observation_space
    kept = spaces.Dict({key: part for key, part in seen.items() if key not in once})
    folder = folder.resolve()  # Minari counts its files wrongly under a relative path
    storage = MinariStorage.new(folder, kept, env.action_space, spec, "hdf5", jpeg_encoding=False)
    env.close()
    for number, episode in enumerate(episodes):
        storage.update_episodes([
            EpisodeBuffer(
                seed=episode.about["scene_seed"], observations=episode.observations, actions=episode.actions,
                rewards=episode.rewards, terminations=episode.terminations, truncations=episode.truncations,
                infos={"is_success": np.arange(len(episode) + 1) > episode.about["solved"]},
            )
        ])  # fmt: skip
        with h5py.File(folder / _FILE, "a") as file:
            group = file[f"episode_{number}"]
            group.attrs["about"] = json.dumps(episode.about)
            for name, array in episode.once.items():
                group[f"once/{name}"] = array
    storage.update_metadata({
        "dataset_id": f"dexgrasp/{settings.agent.rpartition(':')[2].lower()}-{settings.obs_mode}-v0",
        "minari_version": minari.__version__,
        "algorithm_name": settings.agent, "description": "Demonstrations of DexGrasp/Lift-v2",
    })  # fmt: skip


def read_episodes(folder: Path) -> Iterator[Demonstration]:
    """Yield the demonstrations of a folder, one at a time.

    Raises:
        InputError: if there is no data set, or it is damaged.
    """
    require_extra("demos", "reading demonstrations")
    import h5py

    path = folder / DATA / _FILE
    if not path.is_file():
        raise InputError(f"{folder} holds no {DATA}/{_FILE}: make it with `dexgrasp demos generate`")
    try:
        with h5py.File(path, "r") as file:
            for number in range(len(file)):
                yield _episode(file[f"episode_{number}"])
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path} is damaged ({' '.join(str(error).split())[:80]})") from None


def _episode(group: Any) -> Demonstration:
    arrays: Arrays = {}
    group.visititems(lambda name, item: arrays.update({name: item[()]}) if hasattr(item, "dtype") else None)
    return Demonstration.of_arrays(arrays, json.loads(group.attrs["about"]))


def write_robomimic(folder: Path, settings: DemoSettings, episodes: Iterable[Demonstration]) -> None:
    """Write `demos.hdf5` of robomimic into a new folder.

    Each `data/demo_K` has `actions`, `rewards`, `dones`, and `obs` and `next_obs` by key, with pictures as
    `view_K_image` (T, H, W, 3), and an attribute `about`, JSON with object, seeds and certificate. There are no
    `states`: scenes are reproduced from their seeds.
    """
    with from_extra():
        import h5py

    folder.mkdir(parents=True)
    with h5py.File(folder / "demos.hdf5", "w") as file:
        data, total = file.create_group("data"), 0
        for number, episode in enumerate(episodes):
            group, seen = data.create_group(f"demo_{number}"), episode.whole()
            group.attrs.update(num_samples=len(episode), about=json.dumps(episode.about))
            total += len(episode)
            pictures = views_of(seen.pop("rgb")) if "rgb" in seen else {}
            seen |= {f"{name}_image": each for name, each in pictures.items()}
            parts: Arrays = {
                "actions": episode.actions,
                "rewards": episode.rewards,
                "dones": (episode.terminations | episode.truncations).astype(np.int64),
                **{f"obs/{key}": array[:-1] for key, array in seen.items()},
                **{f"next_obs/{key}": array[1:] for key, array in seen.items()},
            }
            for name, array in parts.items():
                group.create_dataset(name, data=array, compression="gzip" if array.ndim > 2 else None)
        about = {
            "env_name": ENV_ID, "env_version": __version__, "type": 2,  # of robomimic's `EnvType`: gym
            "env_kwargs": jsonable(settings.env_arguments) | {"objects": list(settings.objects)},
        }  # fmt: skip
        data.attrs.update(total=total, env_args=json.dumps(about))
        names = np.array([f"demo_{k}" for k in range(len(data))], dtype="S")
        tenth = np.arange(len(data)) % 10 == 9
        file["mask/train"], file["mask/valid"] = names[~tenth], names[tenth]
