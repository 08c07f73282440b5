"""From what is seen to a plan: the one way of agents, of `dexgrasp plan`, and of point clouds of one's own."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.geometry.completion import NoTarget, target_of
from dexgrasp.geometry.neighbours import neighbours_of, points_around, without_splinters
from dexgrasp.geometry.request import ANYHOW, Demand, GraspRequest
from dexgrasp.planning.cvae_source import make_source
from dexgrasp.planning.diverse import plan_many, with_success_probability
from dexgrasp.planning.planner import Planner, compile_ahead
from dexgrasp.planning.relaxation import nearest_relaxation
from dexgrasp.planning.result import PlanResult, Progress
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Array, array
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.cloud import Cloud
from dexgrasp_env.perception.pipeline import find_object
from dexgrasp_env.perception.robot import RobotShape
from dexgrasp_env.perception.scan import cloud_of
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.perception.selection import TargetSelector, mask_of
from dexgrasp_env.poses import placed
from dexgrasp_env.robot.cell import Cell, Given, default_cell, make_cell
from dexgrasp_env.robot.model import compiled_robot, posed
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.robot.table import SeenTable
from dexgrasp_env.valid import NATURAL, check


def plan_scene(
    planner: Planner, scene: Scene, seed: int, start: Array, *,
    progress: Progress | None = None, neighbour_margin: float = 0.0, relax: bool = False,
) -> PlanResult:  # fmt: skip
    """Plan a grasp of the object in a scene, or several that differ.

    Args:
        planner: who plans, as its request says.
        scene: what is seen.
        seed: of everything that is drawn; the same scene and seed give the same grasp.
        start: (n,) rad, set-points the robot approaches from.
        progress: called with steps done and steps in all, where there is a count.
        neighbour_margin: m that neighbours may be pushed, see `neighbours_of`.
        relax: where what the planner is asked for cannot be had, say in `relaxation` what can.
    """
    began = time.perf_counter()
    if scene.reason is None:
        scene = without_splinters(scene)
    planner = planner.seeing(_table_of(scene, planner.cell, neighbour_margin))
    request = planner.request
    count = request.count
    try:
        target = replace(
            target_of(scene, request.mass, planner.settings.most_parts),
            neighbours=neighbours_of(scene, neighbour_margin),
            demand=Demand(request, planner.cell.T_base_world),
        )
    except NoTarget as none:
        result = PlanResult(
            settings=planner.settings, seed=seed, asked=count, shortfall=str(none), sentence=scene.sentence
        )
    else:
        hull_seconds = time.perf_counter() - began
        if count is None:
            result = planner.plan(target, seed, start)
        else:
            result = plan_many(planner, target, seed, start, progress)
        if request.min_probability is not None:
            result = with_success_probability(result, planner, start, progress)
        result.log.seconds = {"hull": hull_seconds} | result.log.seconds
        holds = any(grasp.certificate.holds for grasp in result.grasps)
        if relax and request and planner.settings.seconds is None and not holds:
            result.relaxation = nearest_relaxation(planner, target, seed, start, result.log)
    result.planning_seconds = time.perf_counter() - began
    return result


def _table_of(scene: Scene, cell: Cell, give: float) -> SeenTable | None:
    """Return the table that was seen, with what was seen around the target and may not be pushed."""
    table = scene.table
    if table is None or scene.reason is not None or give:
        return table
    around = placed(cell.seeing(table).T_base_world, points_around(scene))
    return replace(table, around=np.round(around, 5))


def start_of(observation: Observation, robot: Robot) -> Array:
    """Return the set-points (n,) rad that an episode begins with.

    Raises:
        InputError: where the robot cannot be there: planning from such a start takes minutes to fail.
    """
    if not isinstance(observation, Mapping) or "joint_targets" not in observation:
        raise InputError(
            "the observation has no joint_targets: make the environment with the agent's env_settings"
        )
    start = np.asarray(observation["joint_targets"], dtype=float)
    beyond = 0.1  # rad that set-points may be outside the joint ranges: servos and noise
    low, high = robot.lower - beyond, robot.upper + beyond
    if start.shape != low.shape or not ((start > low) & (start < high)).all():
        raise InputError(f"joint_targets must be {len(low)} set-points within the joint ranges, in rad")
    return start


def plan_cloud(
    points: Any,
    *,
    near: Sequence[float] | None = None,
    box: Sequence[float] | None = None,
    mask: Any = None,
    label: int | None = None,
    seed: int = 0,
    start: Array | None = None,
    planner: Planner | None = None,
    robot: Given = None,
    request: GraspRequest = ANYHOW,
) -> PlanResult:
    """Plan a grasp of an object in a cloud, or several that differ; what else stands there is kept clear of.

    The scene stands on a table, which is kept clear of where it is seen; the robot may be in the cloud where it stands
    at `start`. Points are given in the frame of the robot's base; the plan is in the world, whose z = 0 is the table's
    top as it was seen. Grasp files are in the frame of the base again.

    Args:
        points: (N, 3) m in the frame of the robot's base, z up, or a `Cloud` as `read_scan` returns it.
        near: (3,) m, a point near the object that is meant; with nothing pointed at, the only one in the workspace.
        box: (6,) m, instead: x, y, z of the lowest and of the highest corner of a box that holds it.
        mask: instead: one bool, or one whole number, for each point, or for each pixel that the cloud was made from.
        label: the object's number in such a mask; None where it has but one.
        seed: of everything that is drawn; the same cloud and seed give the same grasp.
        start: (n,) rad, where the robot stands; its home posture by default.
        planner: one of your own, with its cell; the default planner otherwise.
        robot: a cell, a robot, or the file of either; None: the simulated cell.
        request: where and how it is to be grasped, its mass and friction, how many grasps; where that cannot be had,
            `.relaxation` says what can.

    Returns:
        A plan with `.grasp`, or with `.reason` why there is none; with a count, `.found` are all, firmest first.

    Raises:
        InputError: for something that is no cloud, a point, box or mask that is none, or fingers that make no grasp of
            the hand.
    """
    planner = (planner or default_planner(make_cell(robot))).asking(request)
    home = planner.cell.robot.home
    q = check("start", home if start is None else start, array(len(home)))
    corners = None if box is None else check("box", box, array(6)).reshape(2, 3)
    where = None if near is None else check("near", near, array(3))
    selector = TargetSelector(where, corners, None if mask is label is None else mask_of(mask, label))
    scene = scene_of(points, selector, seed=check("seed", seed, NATURAL), start=q, cell=planner.cell)
    return plan_scene(planner, scene, seed, q, relax=True)


def scene_of(
    points: Any,
    selector: TargetSelector | None = None,
    *,
    seed: int = 0,
    start: Array | None = None,
    cell: Cell | None = None,
) -> Scene:
    """Return the scene of a cloud without the robot of a cell; the rest is as in `plan_cloud`."""
    cloud = points if isinstance(points, Cloud) else cloud_of(points)
    cell = cell or default_cell()
    data = posed(compiled_robot(cell), cell.robot.home if start is None else start)
    return find_object(cloud, np.random.default_rng(seed), cell, selector=selector, own=_shape(cell).at(data))


@lru_cache(maxsize=8)
def _shape(cell: Cell) -> RobotShape:
    return RobotShape(compiled_robot(cell))


def default_planner(cell: Cell, settings: PlannerSettings | None = None, proposals: str = "auto") -> Planner:
    """Return the planner of agent `bilevel`, its compiled code loaded; `proposals` are of a source of that name."""
    source = make_source(proposals, cell.robot)
    compile_ahead(cell, source)
    return Planner(settings, source, cell)
