"""Demonstrations in the layout of LeRobot's data sets, version 3, written with pyarrow only.

`data/` has a row for each control step, `meta/episodes/` one for each episode, `meta/info.json` the columns and
`meta/stats.json` their distributions. LeRobot's policies take `observation.state` (joints),
`observation.environment_state` (the object) and `observation.images.*`. Clouds and depth images that were observed once
are in the table of episodes, flattened, with object, seeds and success; pictures are stored at every step.
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.data.demonstrations.rollout import Demonstration
from dexgrasp.data.demonstrations.settings import DemoSettings
from dexgrasp_env.arrays import AnyArray, Arrays, Fields
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import write_json
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.scene.constants import CONTROL_PERIOD
from dexgrasp_env.valid import Names
from dexgrasp_env.yaml_file import read_yaml

_DATA = "data/chunk-000/file-000.parquet"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_PICTURES = 4
"""Axes of an array of pictures."""
_QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)


def write_lerobot(folder: Path, settings: DemoSettings, episodes: Iterable[Demonstration]) -> None:
    """Write a data set of LeRobot into a new folder."""
    with from_extra():
        import pyarrow as pa
        import pyarrow.parquet as pq

    robot, common = make_cell(settings.robot).robot, read_yaml(Path(__file__).with_name("lerobot.yaml"))
    for file in (_DATA, _EPISODES):
        (folder / file).parent.mkdir(parents=True)
    writer: Any = None
    parts: dict[str, list[tuple[int, AnyArray]]] = {}
    rows: list[Fields] = []
    tasks: dict[str, int] = {}
    start = 0
    for number, episode in enumerate(episodes):
        task = task_of(episode.about["object"])
        columns = _columns(episode, number, start, tasks.setdefault(task, len(tasks)))
        table = pa.table({name: _array(pa, values) for name, values in columns.items()})
        writer = writer or pq.ParquetWriter(folder / _DATA, table.schema)
        writer.write_table(table)
        for name, values in columns.items():
            parts.setdefault(name, []).append(_part(values))
        own = {name: _statistics(each[-1:]) for name, each in parts.items()}
        rows.append(common["episode"] | _episode_row(episode, number, start, task, own))
        start += len(episode)
    writer.close()
    pq.write_table(pa.Table.from_pylist(rows), folder / _EPISODES)
    names = pa.table({"task_index": list(tasks.values()), "task": list(tasks)})
    pq.write_table(
        names.replace_schema_metadata({"pandas": json.dumps(common["pandas"])}),
        folder / "meta" / "tasks.parquet",
    )
    write_json(folder / "meta" / "stats.json", {name: _statistics(each) for name, each in parts.items()})
    info = common["info"] | {
        "robot_type": robot.name, "total_episodes": len(rows), "total_frames": start, "total_tasks": len(tasks),
        "fps": round(1 / CONTROL_PERIOD), "splits": {"train": f"0:{len(rows)}"},
        "features": {name: _feature(values, robot.joints) for name, values in columns.items()},
    }  # fmt: skip
    write_json(folder / "meta" / "info.json", info)


def task_of(name: str) -> str:
    """Return the task description for an object."""
    return f"lift {name}"


def lerobot_observation(observation: Observation) -> Fields:
    """Return an observation, or a batch of them, in LeRobot's layout.

    `agent_pos` (..., n) joints rad; `environment_state` (..., 17) mass kg, pose, size m, velocity of the object where
    the state is seen; `pixels` by view, (..., H, W, 3) uint8, where colours are.
    """
    seen: Fields = {"agent_pos": observation["joint_positions"]}
    if about := [observation[key] for key in sorted(observation) if key.startswith("object_")]:
        seen["environment_state"] = np.concatenate(about, axis=-1)
    if "rgb" in observation:
        seen["pixels"] = views_of(observation["rgb"])
    return seen


def views_of(pictures: AnyArray) -> Arrays:
    """Return pictures (..., views, H, W, 3) by view."""
    return {f"view_{k}": picture for k, picture in enumerate(np.moveaxis(pictures, -4, 0))}


def _columns(episode: Demonstration, number: int, start: int, task: int) -> Arrays:
    count = len(episode)
    steps, moving = np.arange(count), (*episode.observations, "rgb")
    seen = {key: array[:-1] for key, array in episode.whole().items() if key in moving}
    laid = lerobot_observation(seen)
    laid = {"state": laid.pop("agent_pos")} | laid
    laid |= {f"images.{name}": picture for name, picture in laid.pop("pixels", {}).items()}
    laid |= {key: array.reshape(count, -1) for key, array in seen.items() if key != "rgb"}
    return {
        **{f"observation.{key}": array for key, array in laid.items()},
        "action": episode.actions,
        "next.reward": episode.rewards.astype(np.float32),
        "next.success": steps >= episode.about["solved"],
        "next.done": steps == count - 1,
        "timestamp": (CONTROL_PERIOD * steps).astype(np.float32),
        "frame_index": steps,
        "episode_index": np.full(count, number),
        "index": start + steps,
        "task_index": np.full(count, task),
    }


def _array(pa: Any, values: AnyArray) -> Any:
    if values.ndim == _PICTURES:
        import imageio.v3 as iio

        still = values.strides[0] == 0  # one picture all along
        files = [
            {"bytes": iio.imwrite("<bytes>", each, extension=".png"), "path": None}
            for each in (values[:1] if still else values)
        ] * (len(values) if still else 1)
        return pa.array(files, pa.struct([("bytes", pa.binary()), ("path", pa.string())]))
    numbers = pa.array(values.ravel())
    if values.size == len(values):  # LeRobot has single numbers as such
        return numbers
    return pa.FixedSizeListArray.from_arrays(numbers, values.shape[1])


def _episode_row(
    episode: Demonstration, number: int, start: int, task: str, statistics: dict[str, Fields]
) -> Fields:
    row = {
        "episode_index": number, "tasks": [task], "length": len(episode),
        "dataset_from_index": start, "dataset_to_index": start + len(episode),
        "scene_seed": episode.about["scene_seed"], "about": json.dumps(episode.about),
    }  # fmt: skip
    row |= {f"once/{key}": np.ravel(array).tolist() for key, array in episode.once.items() if key != "rgb"}
    return row | {
        f"stats/{name}/{kind}": value for name, own in statistics.items() for kind, value in own.items()
    }


def _feature(values: AnyArray, joints: Names) -> Fields:
    if values.ndim == _PICTURES:
        return {"dtype": "image", "shape": list(values.shape[1:]), "names": ["height", "width", "channels"]}
    width = 1 if values.ndim == 1 else values.shape[1]
    names = list(joints) if width == len(joints) else None
    return {"dtype": str(values.dtype), "shape": [width], "names": names}


def _part(values: AnyArray) -> tuple[int, AnyArray]:
    """Return number of rows (n,) or (n, m), or of pictures (n, H, W, 3), and what `_statistics` needs of them.

    This is minimum, maximum, mean, mean square and quantiles; of pictures by colour, from 0 to 1.
    """
    if values.ndim == _PICTURES:
        x = values[:, ::4, ::4].reshape(-1, 3, 1, 1) / 255.0
    else:
        x = values.reshape(len(values), -1).astype(float)
        # The many numbers of clouds and depth pictures are described together.
        x = x if x.shape[1] <= 256 else x.reshape(-1, 1)
    moments = x.min(0), x.max(0), x.mean(0), (x**2).mean(0)
    return len(values), np.array([*moments, *np.quantile(x, _QUANTILES, axis=0)])


def _statistics(parts: Sequence[tuple[int, AnyArray]]) -> dict[str, list[float] | list[int]]:
    """Return minimum, maximum, mean, standard deviation and quantiles of a column, by LeRobot's names.

    Quantiles over several episodes are the means of theirs, weighted by length, as in LeRobot.
    """
    counts, rows = zip(*parts, strict=True)
    _, _, mean, square, *quantiles = np.average(rows, axis=0, weights=counts)
    return {
        "min": np.min(rows, axis=0)[0].tolist(), "max": np.max(rows, axis=0)[1].tolist(), "mean": mean.tolist(),
        "std": np.sqrt(np.maximum(square - mean**2, 0.0)).tolist(), "count": [sum(counts)],
        **{f"q{round(100 * q):02d}": row.tolist() for q, row in zip(_QUANTILES, quantiles, strict=True)},
    }  # fmt: skip
