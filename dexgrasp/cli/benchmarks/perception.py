"""Cost of perception by step against the raw ray rate, and its accuracy over the objects."""

import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from dexgrasp.cli.benchmarks.cloud_accuracy import measure_accuracy
from dexgrasp.cli.benchmarks.timing import clocks, seconds_of
from dexgrasp.geometry.hull import cloud_corners
from dexgrasp_env.arrays import Fields
from dexgrasp_env.objects.catalogue import OBJECT_SETS
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.rest_poses import rest_poses
from dexgrasp_env.perception import pipeline
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.scene.build import build_scene
from dexgrasp_env.sensing.perception import Perception
from dexgrasp_env.sensing.raycast import SEEN, RayCameras
from dexgrasp_env.sensing.sensor import SensorModel
from dexgrasp_env.tasks.placement import Placement

_SEGMENT = (
    "remove_flying", "gather", "fit_plane", "view_corrections", "level_views", "refine_plane", "crop",
    "table_clearance", "remove_outliers", "linked", "downsample", "smooth",
)  # fmt: skip
_STEPS = ((RayCameras, "render"), (SensorModel, "measure"), *((pipeline, name) for name in _SEGMENT))
"""What an observation calls, by the place that it finds it at."""
OBJECT = "sugar_box"
BUDGET_MS = 60.0
"""For four 160 x 120 depth images and the cloud, one core, no GL."""


def run(quick: bool = False) -> Fields:
    """Return the cost of each step [ms, medians], the ray rates, and the total against the budget.

    `ray_rate_ratio` is the rate of the depth images over that of `mj_multiRay` alone on the same rays,
    unmended and writing to one buffer; `render_share` the share of the images in the total.

    Args:
        quick: fewer repetitions.
    """
    repeats = 5 if quick else 31
    model, data, _ = _scene(OBJECT, np.random.default_rng(0), 0)
    perception, rng = Perception(model, default_cell().make_cameras()), np.random.default_rng(1)
    perception.reset(rng)
    seen = perception.observe(data, rng)  # compiles
    rows = [_times(perception, data, rng) for _ in range(repeats)]
    times = {name: np.median([row[name] for row in rows]) for name in rows[0]}
    total = times.pop("total")
    rays = sum(c.intrinsics.width * c.intrinsics.height for c in perception.cameras)
    raw = _median_ms(_raw_rays(model, data, perception), repeats)
    return {
        "object": OBJECT,
        "steps_ms": times,
        "total_ms": total,
        "hull_ms": _median_ms(lambda: cloud_corners(seen.target.points, seen.plane), repeats),
        "budget_ms": BUDGET_MS,
        "render_share": times["render"] / total,
        "raw_rays_per_second": rays / raw * 1e3,
        "rays_per_second": rays / times["render"] * 1e3,
        "ray_rate_ratio": raw / times["render"],
    }


def accuracy(poses: int = 5) -> Fields:
    """Return the measures of `cloud_accuracy` by object of the test set (medians over poses) and over all observations.

    Args:
        poses: observations of each object, each at a random place, yaw and rest pose, freshly calibrated.
    """
    rows = {
        name: [_observation(name, pose, index) for pose in range(poses)]
        for index, name in enumerate(OBJECT_SETS["all20"])
    }
    everything = [row for group in rows.values() for row in group]
    return {"by_object": {name: _summary(group) for name, group in rows.items()}, "all": _summary(everything)}


def _observation(name: str, pose: int, seed: int) -> Fields:
    rng = np.random.default_rng((seed, pose))
    model, data, shape = _scene(name, rng, pose)
    perception = Perception(model, default_cell().make_cameras())
    perception.reset(rng)
    return measure_accuracy(perception.observe(data, rng), perception, data, shape.mesh)


def _summary(rows: list[Fields]) -> Fields:
    seen = [row for row in rows if row["reason"] is None]
    out: Fields = {"observations": len(rows), "failures": [r["reason"] for r in rows if r["reason"]]}
    if not seen:
        return out
    column = {name: np.array([row[name] for row in seen], float) for name in seen[0] if name != "reason"}
    return out | {
        **{f"{name}_mm": 1e3 * np.median(column[name]) for name in ("median", "p95", "worst")},
        "largest_p95_mm": 1e3 * column["p95"].max(),
        "covered": np.median(column["covered"]),
        **{name: int(column[name].sum()) for name in ("false_points", "stray_points", "table_points")},
        "hull_volume": np.median(column["hull_volume"]),
        "hull_volume_error": np.median(np.abs(column["hull_volume"] - 1.0)),
    }


def _scene(
    name: str, rng: np.random.Generator, pose: int
) -> tuple[mujoco.MjModel, mujoco.MjData, ObjectModel]:
    """Return a scene, the robot at home and the object at rest: pose n takes its n-th rest pose."""
    shape = load_object(name)
    rest = "likely" if shape.fixed_pose is not None else pose % len(rest_poses(shape))
    cell = default_cell()
    model = build_scene(shape, cell)
    data = mujoco.MjData(model)
    data.qpos[:-7] = cell.robot.home
    data.qpos[-7:] = Placement(rest_pose=rest).sample(shape, rng)
    mujoco.mj_forward(model, data)
    return model, data, shape


def _times(perception: Perception, data: mujoco.MjData, rng: np.random.Generator) -> dict[str, float]:
    """Return what each step of an observation takes, ms, and the whole."""
    start = time.perf_counter()
    with clocks(*_STEPS) as seconds:
        perception.observe(data, rng)
    seconds["total"] = [time.perf_counter() - start]
    return {name: 1e3 * sum(each) for name, each in seconds.items()}


def _raw_rays(model: mujoco.MjModel, data: mujoco.MjData, perception: Any) -> Callable[[], None]:
    casts = [(c.position, rays) for c, rays in zip(perception.cameras, perception.rays.rays, strict=True)]
    n = len(casts[0][1]) // 3
    geom, distance = np.empty(n, np.int32), np.empty(n)

    def cast() -> None:
        """Cast the rays of all cameras, and do nothing else."""
        for position, rays in casts:
            mujoco.mj_multiRay(model, data, position, rays, SEEN, True, -1, geom, distance, None, n, 10.0)

    return cast


def _median_ms(step: Callable[[], object], repeats: int) -> float:
    return float(1e3 * np.median(seconds_of(step, repeats)))
