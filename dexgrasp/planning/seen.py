"""From what is seen to a plan: the one way of agents, of `plan` and of clouds of one's own."""

import time

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.planning.many import plan_many
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.result import PlanResult, Progress
from dexgrasp.planning.settings import GRASPS
from dexgrasp.shape.completion import NoTarget, target_of
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.valid import check

_BEYOND = 0.1  # rad that set-points may be outside the joint ranges: servos and noise


def plan_scene(
    planner: Planner, scene: Scene, seed: int, start: Array, *,
    mass: float | None = None, count: int | None = None, progress: Progress | None = None,
) -> PlanResult:  # fmt: skip
    """Plan a grasp of the object in a scene, or several that differ.

    Args:
        planner: who plans.
        scene: what is seen.
        seed: of everything that is drawn; the same scene and seed give the same grasp.
        start: (n,) rad, set-points the robot approaches from.
        mass: kg where it is known; None assumes one from the volume.
        count: grasps asked for; None plans one.
        progress: called with steps done and steps in all, where there is a count.

    Raises:
        InputError: for a count out of range.
    """
    if count is not None:
        check("count", count, GRASPS)
    began = time.perf_counter()
    try:
        target = target_of(scene, mass)
    except NoTarget as none:
        seconds = time.perf_counter() - began
        return PlanResult(
            settings=planner.settings, seed=seed, asked=count, shortfall=none.reason, sentence=scene.sentence,
            planning_seconds=seconds,
        )  # fmt: skip
    hull_seconds = time.perf_counter() - began
    if count is None:
        result = planner.plan(target, seed, start)
    else:
        result = plan_many(planner, target, count, seed, start, progress)
    result.log.seconds = {"hull": hull_seconds} | result.log.seconds
    result.planning_seconds = time.perf_counter() - began
    return result


def start_of(observation: Observation, robot: Robot) -> Array:
    """Return the set-points (n,) rad that an episode begins with.

    Raises:
        InputError: where the robot cannot be there: planning from such a start takes minutes to fail.
    """
    start = np.asarray(observation["joint_targets"], dtype=float)
    low, high = robot.lower - _BEYOND, robot.upper + _BEYOND
    if start.shape != low.shape or not ((start > low) & (start < high)).all():
        raise InputError(f"joint_targets must be {len(low)} set-points within the joint ranges, in rad")
    return start
