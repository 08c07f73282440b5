"""The hard-coded baseline of section 3.5 of the supplementary: one posture over the middle of the cloud.

Its postures are tuned for Allegro; any other hand pinches, a gripper antipodally.
"""

import time

import numpy as np

from dexgrasp.agent import BY_CLOUD, Agent, Info, Observation, Report, cell_of
from dexgrasp.agents.hand_postures import hand_postures
from dexgrasp.geometry.completion import NO_VOLUME, NoTarget, target_of
from dexgrasp.geometry.hull import standing_hull
from dexgrasp.geometry.surface_samples import triangle_samples
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.motion.motion import NoPath, Played
from dexgrasp.motion.to_pose import arm_at, plan_with_arm
from dexgrasp.planning.plan_scene import start_of
from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.robot.cell import default_cell


class HardcodedAgent(Agent):
    """Puts the same hand posture over every object and closes it.

    The wrist goes over the mean of the cloud, at a fixed height above its top, turned so that thumb and
    fingers close along the short principal axis of the cloud seen from above. Nothing else of the shape is
    used, but that the way there keeps clear of the cloud's convex hull. Index and middle go to fixed
    positions; the thumb's servo saturates and presses the object against them whatever its width.
    """

    env_settings = BY_CLOUD

    def __init__(self) -> None:
        self._motion: Played | None = None

    def reset(self, observation: Observation, info: Info) -> None:
        """Plan from the cloud; stand still for the episode where that fails.

        Raises:
            InputError: for an observation without a cloud.
        """
        began = time.perf_counter()
        self._cell = cell_of(info, default_cell())
        start = start_of(observation, self._cell.robot)
        tree = robot_tree(self._cell)
        self._motion = Played(start[None], tree)
        self.report = Report()
        points = self._points(Scene.of_observation(observation, info))
        if len(points) < 20:
            self.report.failure = "no_cloud"
            return
        try:
            self._motion = Played(self._plan(start, points).targets, tree)
        except NoPath as blocked:
            self.report.failure = blocked.reason
            self.report.details = {"detail": blocked.detail}
        self.report.planning_seconds = time.perf_counter() - began

    def act(self, observation: Observation) -> Single:
        """Return the next action of the motion.

        Raises:
            InputError: before the first reset.
        """
        if self._motion is None:
            raise InputError("this agent has seen nothing yet: call reset(observation, info) before act()")
        return self._motion.action(observation["joint_positions"])

    def _points(self, scene: Scene) -> Array:
        """Return the points (N, 3) m that stand for the object: those that are seen."""
        return scene.target.points

    def _plan(self, start: Array, points: Array) -> ActionScript:
        """Return the script of the first arm that has one."""
        hands = hand_postures(self._cell).hands(points, short_axis(points))
        try:
            obstacle = standing_hull(points)
        except InputError as flat:
            raise NoPath(NO_VOLUME, str(flat)) from None
        blocked = NoPath("out_of_reach", "the arm reaches neither of the two turns of the wrist")
        for arm in self._arms(start, points):
            try:
                return plan_with_arm(arm, hands, obstacle, start, self._cell)
            except NoPath as reason:
                blocked = reason
        raise blocked

    def _arms(self, start: Array, points: Array) -> list[Array]:
        """Return the configurations (a,) rad to try, of both wrist turns, nearer to `start` first."""
        axis = short_axis(points)
        arms = self._reached(start, points, [axis, -axis])
        return sorted(arms, key=lambda arm: np.abs(arm - start[: len(arm)]).max())

    def _reached(self, start: Array, points: Array, axes: list[Array]) -> list[Array]:
        """Return the configurations (a,) rad of the arm for grips along axes (3,), those that it reaches."""
        postures, tree = hand_postures(self._cell), robot_tree(self._cell)
        arms = (arm_at(postures.palm(points, axis), start, tree) for axis in axes)
        return [arm for arm in arms if arm is not None]


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
        return triangle_samples(np.concatenate(target.distance.parts), 512, 0).points


def short_axis(points: Array) -> Array:
    """Return the unit vector (3,), level, of the smaller principal axis of points (N, 3) seen from above."""
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    _, axes = np.linalg.eigh((flat[:, :, None] * flat[:, None, :]).mean(axis=0))
    return np.array([*axes[:, 0], 0.0])
