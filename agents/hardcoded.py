"""The hard-coded baseline of section 3.5 of the supplementary: one posture over the middle of the cloud.

Its postures are tuned for Allegro; any other hand pinches, a gripper antipodally.
"""

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from dexgrasp.agent import BY_CLOUD, Agent, Observation, Report, cell_of
from dexgrasp.agents.pinch import pinch_of
from dexgrasp.geometry.completion import NO_VOLUME, NoTarget, target_of
from dexgrasp.geometry.hull import standing_hull
from dexgrasp.geometry.surface_samples import triangle_samples
from dexgrasp.grasp.grasp import GraspMotion
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.mechanics.kinematics.palm_ik import hanging_palm, solve_palm
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.script import make_script
from dexgrasp.planning.plan_scene import start_of
from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.tasks.control import normalise

# Joints by finger, rad; the ring finger is out of the way.
_RING = {"ring": (0.0, -0.15, 0.0, 0.0)}
_AROUND = {"index": (-0.099, 0.773, 0.936, -0.227), "middle": (0.059, 0.768, 0.969, -0.227)} | _RING
_OPEN = {
    "index": (-0.149, 0.858, 0.0, 0.044), "middle": (0.064, 0.857, 0.0, 0.068), **_RING,
    "thumb": (1.38, 0.35, -0.1, 0.2),
}  # fmt: skip
_CLOSED = _AROUND | {"thumb": (1.38, 0.35, 0.45, 0.2)}
_FIRM = _AROUND | {"thumb": (1.38, 0.35, 0.85, 0.2)}
Posture = Mapping[str, tuple[float, ...]]
_HANDS = _OPEN, _CLOSED, _FIRM
"""Wide around the object; the thumb half way; the thumb's set-point inside any object, so that its servo saturates."""
_TILT = 0.2  # rad, thumb up: the thumb is the longer
# Where the palm goes, m: u along the short axis of the object, from thumb to fingers, v across it.
_U, _V = 0.010, -0.028  # from the cloud's mean
_ABOVE = 0.045  # above the cloud's highest point
_LEAST_Z = 0.137  # above the table, which the fingertips must clear
_MIN_POINTS = 20
_COMPLETED_POINTS = 512
_IK_ERROR = 0.003  # m


class HardcodedAgent(Agent):
    """Puts the same hand posture over every object and closes it.

    The wrist goes over the mean of the cloud, at a fixed height above its top, turned so that thumb and
    fingers close along the short principal axis of the cloud seen from above. Nothing else of the shape is
    used, but that the way there keeps clear of the cloud's convex hull. Index and middle go to fixed
    positions; the thumb's servo saturates and presses the object against them whatever its width.
    """

    env_settings = BY_CLOUD

    def __init__(self) -> None:
        self._script: ActionScript | None = None
        self._rest: Single | None = None

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Plan from the cloud; stand still for the episode where that fails.

        Raises:
            InputError: for an observation without a cloud.
        """
        began = time.perf_counter()
        self._cell = cell_of(info, default_cell())
        start = start_of(observation, self._cell.robot)
        self._script = None
        self._step, self._rest = 0, self._action(start)
        self.report = Report()
        points = self._points(Scene.of_observation(observation, info))
        if len(points) < _MIN_POINTS:
            self.report.failure = "no_cloud"
            return
        try:
            self._script = self._plan(start, points)
        except NoPath as blocked:
            self.report.failure = blocked.reason
            self.report.details = {"detail": blocked.detail}
        self.report.planning_seconds = time.perf_counter() - began

    def act(self, observation: Observation) -> Single:
        """Return the next action of the script.

        Raises:
            InputError: before the first reset.
        """
        if self._rest is None:
            raise InputError("this agent has seen nothing yet: call reset(observation, info) before act()")
        if self._script is None:
            return self._rest
        action = self._action(self._script.at(self._step))
        self._step += 1
        return action

    def _points(self, scene: Scene) -> Array:
        """Return the points (N, 3) m that stand for the object: those that are seen."""
        return scene.target.points

    def _action(self, targets: Array) -> Single:
        return normalise(targets, self._cell.robot).astype(np.float32)

    def _plan(self, start: Array, points: Array) -> ActionScript:
        tree, hands = robot_tree(self._cell), list(map(self._hand, _HANDS)) if self._tuned else []
        hands = hands or pinch_of(self._cell).hands(points, short_axis(points))
        try:
            obstacle = standing_hull(points)
        except InputError as flat:
            raise NoPath(NO_VOLUME, str(flat)) from None
        blocked = NoPath("out_of_reach", "the arm reaches neither of the two turns of the wrist")
        for arm in self._arms(tree, start, points):
            motion = GraspMotion(*(np.concatenate([arm, hand]) for hand in hands))
            try:
                return make_script(start, motion, obstacle, self._cell, margin=0.002)
            except NoPath as reason:
                blocked = reason
        raise blocked

    @property
    def _tuned(self) -> bool:
        """True of the hand that the postures were tuned for."""
        fingers = self._cell.robot.hand.fingers
        return all(len(_OPEN.get(finger.name, ())) == len(finger.joints) for finger in fingers)

    def _hand(self, posture: Posture) -> Array:
        """Return a posture as the hand's joints (h,) rad."""
        return np.concatenate([posture[finger.name] for finger in self._cell.robot.hand.fingers])

    def _arms(self, tree: RobotTree, start: Array, points: Array) -> list[Array]:
        """Return the configurations (a,) rad to try, of both wrist turns, nearer to `start` first."""
        axis = short_axis(points)
        arms = self._reachable(tree, start, points, [axis, -axis])
        return sorted(arms, key=lambda arm: np.abs(arm - start[: tree.arm]).max())

    def _reachable(self, tree: RobotTree, start: Array, points: Array, axes: list[Array]) -> list[Array]:
        """Return the configurations (a,) rad of the arm for grips along axes (3,), those that it reaches."""
        arms = []
        for axis in axes:
            R, p = self._palm(points, axis) if self._tuned else pinch_of(self._cell).palm(points, axis)
            q = start.copy()
            q[0] = np.arctan2(p[1], p[0])
            if solve_palm(q, R, p, tree, 300, 1e-5) < _IK_ERROR:
                arms.append(q[: tree.arm].copy())
        return arms

    @staticmethod
    def _palm(points: Array, axis: Array) -> tuple[Array, Array]:
        """Return rotation (3, 3) and position (3,) m of the palm for a grip along an axis (3,)."""
        R = hanging_palm(axis, _TILT)
        p = points.mean(axis=0) + _U * axis + _V * R[:, 1]
        p[2] = max(points[:, 2].max() + _ABOVE, _LEAST_Z)
        return R, p


class HardcodedCompletedAgent(HardcodedAgent):
    """Agent `hardcoded_completed`: the same posture over the object as the planner takes it to be.

    It is given evenly spread points of the hull or parts that `bilevel` plans on, the unseen side completed.
    """

    def _points(self, scene: Scene) -> Array:
        """Return points (N, 3) m of the planner's target; none where it sees nothing to grasp."""
        try:
            target = target_of(scene)
        except NoTarget:
            return np.empty((0, 3))
        return triangle_samples(np.concatenate(target.distance.parts), _COMPLETED_POINTS, 0).points


def short_axis(points: Array) -> Array:
    """Return the unit vector (3,), level, of the smaller principal axis of points (N, 3) seen from above."""
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    _, axes = np.linalg.eigh((flat[:, :, None] * flat[:, None, :]).mean(axis=0))
    return np.array([*axes[:, 0], 0.0])
