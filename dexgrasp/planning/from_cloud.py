"""From a point cloud of one's own to a plan: what `dexgrasp plan --cloud` does, in Python."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dexgrasp.grasp.file import grasp_json
from dexgrasp.grasp.grasp import Grasp
from dexgrasp.planning.many import GraspSet, Progress, check_count, plan_many
from dexgrasp.planning.plan import Plan
from dexgrasp.planning.planner import Planner, warm_up
from dexgrasp.planning.seen import NO_HULL
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.planning.sources import make_source
from dexgrasp.shape.completion import target_of_cloud
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.cloud import Cloud
from dexgrasp_env.perception.scan import cloud_of
from dexgrasp_env.perception.scene import SceneObject, find_object
from dexgrasp_env.robot.limits import HOME


@dataclass(frozen=True, eq=False)
class CloudPlan:
    """What came of planning on a cloud.

    Attributes:
        seen: the object as it was isolated, or why there is none.
        seed: that it was planned with.
        settings: of the planner.
        target: what was planned on; None without an object.
        plan: of the planner; None without an object.
        seconds: from the isolated object to the certified grasp with its approach.
        found: the grasps where several were asked for; `plan` is then the firmest, or the search that found none.
        asked: how many, where several were.
    """

    seen: SceneObject
    seed: int
    settings: PlannerSettings
    target: GraspTarget | None = None
    plan: Plan | None = None
    seconds: float = 0.0
    found: GraspSet | None = None
    asked: int | None = None

    @property
    def grasps(self) -> list[Grasp]:
        """All certified grasps, firmest first."""
        plans = [self.plan] if self.found is None else self.found.plans
        return [plan.grasp for plan in plans if plan is not None and plan.grasp is not None]

    @property
    def grasp(self) -> Grasp | None:
        """The certified grasp, or None."""
        return None if self.plan is None else self.plan.grasp

    @property
    def reason(self) -> str | None:
        """Why there is no grasp, in a word that can be counted; None with one."""
        if self.seen.reason is not None:
            return self.seen.reason
        if self.plan is None:
            return NO_HULL
        return None if self.plan.grasp is not None else f"no_grasp:{self.plan.reason}"

    def as_json(self, name: str) -> dict[str, Any]:
        """Return what `dexgrasp plan --cloud --json` prints; `grasp` is the content of a grasp file."""
        contents = self.contents(name)
        search = self.plan if self.found is None else self.found.search
        blocked = {} if search is None else search.blocked
        first = contents[0] if contents else None
        result = {
            "schema": 1, "object": name, "success": first is not None, "reason": self.reason,
            "planning_seconds": self.seconds, "stages": {} if search is None else search.seconds,
            "blocked": {reason: count for reason, (count, _) in blocked.items()},
            "violations": {reason: float(least) for reason, (_, least) in blocked.items()},
            "grasp": first, "certificate": None if first is None else first["certificate"],
        }  # fmt: skip
        if self.asked is None:
            return result
        found, enough = self.found or GraspSet(), len(contents) == self.asked
        reason = self.reason or found.search.reason
        return result | found.as_json(contents, self.asked) | {"success": enough, "reason": reason}

    def contents(self, name: str) -> list[dict[str, Any]]:
        """Return the grasps as grasp files hold them, firmest first."""
        plans = [self.plan] if self.found is None else self.found.plans
        seconds = self.seconds / max(len(plans), 1)
        return [
            grasp_json(
                name, plan.grasp, self.target, self.settings, script=plan.script, agent="bilevel",
                seed=self.seed, planning_seconds=seconds,
            )
            for plan in plans if plan is not None and plan.grasp is not None and self.target is not None
        ]  # fmt: skip

    @property
    def sentence(self) -> str:
        """The reason for people, or an empty text."""
        if self.seen.reason is not None:
            return self.seen.sentence
        return "" if self.grasp is not None else str(self.reason)


def plan_cloud(
    points: Any,
    *,
    near: Sequence[float] | None = None,
    mass: float | None = None,
    seed: int = 0,
    start: Array | None = None,
    planner: Planner | None = None,
    count: int | None = None,
    progress: Progress | None = None,
) -> CloudPlan:
    """Plan a grasp of the object in a cloud of the scene, or several that differ.

    The scene stands on a table at the height that the cell has; the table, and the robot where it stands at `start`,
    may be in the cloud. Points are given in the frame of the robot's base; the plan is in the world, whose z = 0 is the
    table's top: the same frame, unless the cell says otherwise. Grasp files are in the frame of the base again.

    Args:
        points: (N, 3) m in the frame of the robot's base, z up, or a `Cloud` as `read_scan` returns it.
        near: (3,) m, a point near the object that is meant; None takes the only one in the workspace.
        mass: kg where it is known; None assumes one from the volume.
        seed: of everything that is drawn; the same cloud and seed give the same grasp.
        start: (23,) rad, where the robot stands; its home posture by default.
        planner: one of your own; the default planner otherwise.
        count: how many grasps that differ; None plans one.
        progress: called with steps done and steps in all, where there is a count.

    Returns:
        A plan with `.grasp`, or with `.reason` why there is none; with a count, `.grasps` are all, firmest first.

    Raises:
        InputError: for something that is no cloud, a point, a mass or a count that is none.
    """
    if count is not None:
        check_count(count)
    cloud = points if isinstance(points, Cloud) else cloud_of(points)
    q = _checked("start", HOME if start is None else start, 23)
    where = None if near is None else _checked("near", near, 3)
    if mass is not None and not (isinstance(mass, int | float) and np.isfinite(mass) and mass > 0):
        raise InputError(f"mass is {mass!r}: valid is a positive number of kilograms")
    planner = planner or default_planner()
    robot, data = _robot_at(q, planner.mount)
    seen = find_object(cloud, np.random.default_rng(seed), near=where, robot=robot, data=data)
    unplanned = CloudPlan(seen, seed, planner.settings, asked=count)
    if seen.reason is not None:
        return unplanned
    began = time.perf_counter()
    shown = seen.cloud
    target = target_of_cloud(shown.valid_points, shown.valid_normals, shown.plane, mass)
    if target is None:
        return unplanned
    found = None if count is None else plan_many(planner, target, count, seed, q, progress)
    plan = planner.plan(target, seed, q) if found is None else [*found.plans, found.search][0]
    return replace(unplanned, target=target, plan=plan, seconds=time.perf_counter() - began, found=found)


def default_planner(mount: str = "palm_normal", friction: float | None = None) -> Planner:
    """Return the planner of agent `bilevel`, its compiled code loaded; for surfaces of some friction, if given."""
    source = make_source("auto")
    warm_up(mount, source)
    settings = PlannerSettings() if friction is None else PlannerSettings.for_friction(friction)
    return Planner(settings, source, mount)


def _checked(name: str, value: Any, size: int) -> Array:
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InputError(f"{name} must be {size} finite numbers")
    return array


def _robot_at(q: Array, mount: str) -> tuple[Any, Any]:
    """Return the robot's shape and its kinematics at `q`."""
    import mujoco

    from dexgrasp_env.perception.robot import RobotShape
    from dexgrasp_env.robot.model import compiled_robot

    model = compiled_robot(mount)
    data = mujoco.MjData(model)
    data.qpos[:23] = q
    mujoco.mj_kinematics(model, data)
    return RobotShape(model), data
