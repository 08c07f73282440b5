"""From a point cloud of one's own to a plan: what `dexgrasp plan --cloud` does, in Python."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.grasp.file import grasp_json
from agents.grasp.grasp import Grasp
from agents.grasp.target import GraspTarget, target_from_points
from agents.planning.plan import Plan
from agents.planning.planner import Planner, warm_up
from agents.planning.settings import PlannerSettings
from agents.policies.bilevel import NO_HULL, make_source
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
    """

    seen: SceneObject
    seed: int
    settings: PlannerSettings
    target: GraspTarget | None = None
    plan: Plan | None = None
    seconds: float = 0.0

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
        content = None
        if self.grasp is not None and self.plan is not None and self.target is not None:
            content = grasp_json(
                name, self.grasp, self.target, self.settings, script=self.plan.script, agent="bilevel",
                seed=self.seed, planning_seconds=self.seconds,
            )  # fmt: skip
        blocked = {} if self.plan is None else self.plan.blocked
        return {
            "schema": 1, "object": name, "success": content is not None, "reason": self.reason,
            "planning_seconds": self.seconds, "stages": {} if self.plan is None else self.plan.seconds,
            "blocked": {reason: count for reason, (count, _) in blocked.items()},
            "violations": {reason: float(least) for reason, (_, least) in blocked.items()},
            "grasp": content, "certificate": None if content is None else content["certificate"],
        }  # fmt: skip

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
) -> CloudPlan:
    """Plan a grasp of the object in a cloud of the scene.

    The scene stands on a table at the height of the robot's base; the table, and the robot where it stands at `start`,
    may be in the cloud.

    Args:
        points: (N, 3) m in the robot base frame, z up, or a `Cloud` as `read_scan` returns it.
        near: (3,) m, a point near the object that is meant; None takes the only one in the workspace.
        mass: kg where it is known; None assumes one from the volume.
        seed: of everything that is drawn; the same cloud and seed give the same grasp.
        start: (23,) rad, where the robot stands; its home posture by default.
        planner: one of your own; the default planner otherwise.

    Returns:
        A plan with `.grasp`, or with `.reason` why there is none.

    Raises:
        InputError: for something that is no cloud, a point or a mass that is none.
    """
    cloud = points if isinstance(points, Cloud) else cloud_of(points)
    q = _checked("start", HOME if start is None else start, 23)
    where = None if near is None else _checked("near", near, 3)
    if mass is not None and not (isinstance(mass, int | float) and np.isfinite(mass) and mass > 0):
        raise InputError(f"mass is {mass!r}: valid is a positive number of kilograms")
    planner = planner or default_planner()
    robot, data = _robot_at(q, planner.mount)
    seen = find_object(cloud, np.random.default_rng(seed), near=where, robot=robot, data=data)
    if seen.reason is not None:
        return CloudPlan(seen, seed, planner.settings)
    began = time.perf_counter()
    target = target_from_points(seen.cloud.valid_points, seen.cloud.plane, mass)
    if target is None:
        return CloudPlan(seen, seed, planner.settings)
    return CloudPlan(
        seen, seed, planner.settings, target, planner.plan(target, seed, q), time.perf_counter() - began
    )


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
    from dexgrasp_env.robot.model import robot_spec

    model = robot_spec(mount).compile()
    data = mujoco.MjData(model)
    data.qpos[:23] = q
    mujoco.mj_kinematics(model, data)
    return RobotShape(model), data
