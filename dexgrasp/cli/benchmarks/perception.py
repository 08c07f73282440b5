"""Benchmark of perception: cost by step, and ray rate against that of MuJoCo alone."""

import gc
import timeit
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

from dexgrasp.geometry.hull import cloud_corners
from dexgrasp_env.arrays import Fields
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.sensing.perception import Perception
from dexgrasp_env.sensing.raycast import SEEN

OBJECT = "sugar_box"


def run(quick: bool = False) -> Fields:
    """Return median times [ms] of an observation, its parts and the hull, the ratio of ray rates, and the budget.

    `ray_rate_ratio` is the rate of the depth images over that of `mj_multiRay` alone on the same rays, without
    corrections and into one buffer; `render_share` is the share of the images in the total.

    Args:
        quick: fewer repetitions.
    """
    repeats = 5 if quick else 31
    env: Any = gym.make("DexGrasp/Lift-v2", objects=OBJECT).unwrapped
    env.reset(seed=0)
    model, data = env.model, env.data
    perception, rng = Perception(model, default_cell().make_cameras()), np.random.default_rng(1)
    perception.reset(rng)
    seen, depths = perception.observe(data, rng), perception.rays.render(data)  # compiles
    total = _median_ms(lambda: perception.observe(data, rng), repeats)
    render = _median_ms(lambda: perception.rays.render(data), repeats)
    noise = _median_ms(lambda: perception.sensor.measure(depths, perception.cameras, rng), repeats)
    raw = _median_ms(_raw_rays(model, data, perception), repeats)
    return {
        "object": OBJECT,
        "steps_ms": {"render": render, "noise": noise, "cloud": total - render - noise},
        "total_ms": total,
        "hull_ms": _median_ms(lambda: cloud_corners(seen.target.points, seen.plane), repeats),
        "budget_ms": 60.0,  # For four 160 x 120 depth images and the cloud, one core, no GL.
        "render_share": render / total,
        "ray_rate_ratio": raw / render,
    }


def _raw_rays(model: mujoco.MjModel, data: mujoco.MjData, perception: Any) -> Callable[[], None]:
    casts = [(c.position, rays) for c, rays in zip(perception.cameras, perception.rays.rays, strict=True)]
    n = len(casts[0][1]) // 3
    geom, distance = np.empty(n, np.int32), np.empty(n)

    def cast() -> None:
        """Cast the rays of all cameras."""
        for position, rays in casts:
            mujoco.mj_multiRay(model, data, position, rays, SEEN, True, -1, geom, distance, None, n, 10.0)

    return cast


def _median_ms(step: Callable[[], object], repeats: int) -> float:
    return float(1e3 * np.median(timeit.repeat(step, gc.enable, number=1, repeat=repeats)))
