"""Cost of perception by step against the raw ray rate, and its accuracy over the objects."""

from collections.abc import Callable
from typing import Any, TypeVar

import mujoco
import numpy as np

from dexgrasp.benchmarks.cloud_accuracy import measure_accuracy
from dexgrasp.benchmarks.timing import seconds_of
from dexgrasp.shape.hull import cloud_corners
from dexgrasp_env.objects.catalogue import OBJECT_SETS
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.rest_poses import rest_poses
from dexgrasp_env.perception.cloud import (
    clusters,
    crop,
    downsample,
    gather,
    remove_flying,
    remove_outliers,
)
from dexgrasp_env.perception.level import level_views, view_corrections
from dexgrasp_env.perception.normals import smooth
from dexgrasp_env.perception.plane import fit_plane, noise_depth, remove_plane, table_clearance
from dexgrasp_env.perception.segment import COUNT, CROP_HIGH, CROP_LOW, LINK, SIGMAS, STRIDE
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.scene.build import build_scene
from dexgrasp_env.sensing.perception import Perception
from dexgrasp_env.sensing.raycast import SEEN
from dexgrasp_env.tasks.placement import Placement

Result = TypeVar("Result")
OBJECT = "sugar_box"
BUDGET_MS = 60.0
"""For four 160 x 120 depth images and the cloud, one core, no GL."""


def run(quick: bool = False) -> dict[str, Any]:
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
    perception.observe(data, rng)  # compiles
    steps = _steps(perception, data, rng)
    times = {name: _median_ms(step, repeats) for name, step in steps.items()}
    total = times.pop("total")
    rays = sum(c.intrinsics.width * c.intrinsics.height for c in perception.cameras)
    raw = _median_ms(_raw_rays(model, data, perception), repeats)
    return {
        "object": OBJECT,
        "steps_ms": times,
        "total_ms": total,
        "budget_ms": BUDGET_MS,
        "render_share": times["render"] / total,
        "raw_rays_per_second": rays / raw * 1e3,
        "rays_per_second": rays / times["render"] * 1e3,
        "ray_rate_ratio": raw / times["render"],
    }


def accuracy(poses: int = 5) -> dict[str, Any]:
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


def _observation(name: str, pose: int, seed: int) -> dict[str, Any]:
    rng = np.random.default_rng((seed, pose))
    model, data, shape = _scene(name, rng, pose)
    perception = Perception(model, default_cell().make_cameras())
    perception.reset(rng)
    return measure_accuracy(perception.observe(data, rng), perception, data, shape.mesh)


def _summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    seen = [row for row in rows if row["reason"] is None]
    out: dict[str, Any] = {"observations": len(rows), "failures": [r["reason"] for r in rows if r["reason"]]}
    if not seen:
        return out
    column = {name: np.array([row[name] for row in seen], float) for name in seen[0] if name != "reason"}
    return out | {
        **{f"{name}_mm": float(1e3 * np.median(column[name])) for name in ("median", "p95", "worst")},
        "largest_p95_mm": float(1e3 * column["p95"].max()),
        "covered": float(np.median(column["covered"])),
        **{name: int(column[name].sum()) for name in ("false_points", "stray_points", "table_points")},
        "hull_volume": float(np.median(column["hull_volume"])),
        "hull_volume_error": float(np.median(np.abs(column["hull_volume"] - 1.0))),
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


def _steps(perception: Any, data: mujoco.MjData, rng: np.random.Generator) -> dict[str, Callable[[], object]]:
    """Return each step as a call on the results of the steps before it."""
    cameras, steps = perception.believed, dict[str, Callable[[], Any]]()

    def step(name: str, call: Callable[[], Result]) -> Result:
        steps[name] = call
        return call()

    true = step("render", lambda: perception.rays.render(data))
    depths = step("sensor", lambda: perception.sensor.measure(true, perception.cameras, rng))
    mended = step("remove_flying", lambda: remove_flying(depths))
    everything = step("gather", lambda: gather(mended, cameras))
    sparse = everything.select(slice(None, None, STRIDE))
    plane = step("fit_plane", lambda: fit_plane(sparse.points, rng))
    assert plane is not None
    turns = step("view_corrections", lambda: view_corrections(sparse, plane, len(cameras)))
    cropped = step("crop", lambda: crop(everything, CROP_LOW, CROP_HIGH))
    level = step("level_views", lambda: level_views(cropped, turns))
    clearance = table_clearance(plane, level.depth, noise_depth(sparse, plane), SIGMAS)
    above = step("remove_plane", lambda: remove_plane(level, plane, clearance))
    free = step("remove_robot", lambda: above.select(~perception.robot.at(data)(above.points)))
    dense = step("remove_outliers", lambda: remove_outliers(free))
    labels = step("clusters", lambda: clusters(dense, LINK))
    found = dense.select(labels == np.bincount(labels).argmax())
    chosen = found.select(step("downsample", lambda: downsample(found.points, COUNT, rng)))
    points, _ = step("smooth", lambda: smooth(found, chosen, plane.rms))
    step("hull (not in the total)", lambda: cloud_corners(points, plane))
    step("total", lambda: perception.observe(data, rng))
    return steps


def _raw_rays(model: mujoco.MjModel, data: mujoco.MjData, perception: Any) -> Callable[[], None]:
    casts = [
        (c.position, (c.intrinsics.directions().reshape(-1, 3) @ c.rotation.T).ravel())
        for c in perception.cameras
    ]
    n = len(casts[0][1]) // 3
    geom, distance = np.empty(n, np.int32), np.empty(n)

    def cast() -> None:
        for position, rays in casts:
            mujoco.mj_multiRay(model, data, position, rays, SEEN, True, -1, geom, distance, None, n, 10.0)

    return cast


def _median_ms(step: Callable[[], object], repeats: int) -> float:
    return float(1e3 * np.median(seconds_of(step, repeats)))
