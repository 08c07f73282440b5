"""Placing: another agent's grasp, carried to its goal, and let go of where the object is to lie."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from dexgrasp.agent import Agent, Observation, Report, cell_of
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.motion.carried import STILL, carried, let_go
from dexgrasp.motion.motion import arm_and_hand
from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.tasks.control import normalise

_RISEN = 0.08  # m that the palm has come up with the object
_PRESSING = 0.02  # rad that a joint of a hand which holds something lags behind its set-point
_CLEAR = 0.002  # m above the table, where the object is let go of
_AWAY = 0.10  # m that the open hand goes up


class PlacingAgent(Agent):
    """Watches the set-points of an agent of `joint_position` and goes on once it has lifted the object.

    Where the object's middle is, the first cloud says; it is taken to move as the palm does.
    """

    def __init__(self, agent: Agent) -> None:
        self.agent: Any = agent
        if hasattr(self.agent, "turns"):
            self.agent.turns = False  # what is to be put down stays upright
        self.env_settings = dict(agent.env_settings)  # type: ignore[misc]  # of the instance here

    @property
    def report(self) -> Report:
        """Report of the agent on its grasp."""
        return self.agent.report

    @report.setter
    def report(self, report: Report) -> None:
        """Replace the report of the agent."""
        self.agent.report = report

    def seed(self, seed: int) -> None:
        """Seed the agent."""
        self.agent.seed(seed)

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Plan with the agent, and note the place of the object and its goal."""
        self.agent.reset(observation, info)
        points = Scene.of_observation(observation, info).target.points
        self._middle = 0.5 * (points.max(0) + points.min(0)) if len(points) else np.zeros(3)
        self._goal = np.asarray(observation["desired_goal"], dtype=float)
        self._cell = cell_of(info, default_cell())
        self._tree = robot_tree(self._cell)
        self._low: Array | None = None  # set-points when the hand came down, still open
        self._lowest = self._height = np.inf  # m, of the palm then, and a step ago
        self._way: Iterator[Array] = iter(())
        self._last: Array | None = None

    def act(self, observation: Observation) -> Single:
        """Return the agent's action, or from the end of its lift on the next on the way to the goal."""
        targets = np.asarray(observation["joint_targets"], dtype=float)
        if self._last is None and self._lifted(
            targets, np.asarray(observation["joint_positions"], dtype=float)
        ):
            self._way, self._last = self._deliver(targets), targets
        if self._last is None:
            return self.agent.act(observation)
        self._last = next(self._way, self._last)
        return normalise(self._last, self._tree).astype(np.float32)

    def _lifted(self, targets: Array, q: Array) -> bool:
        robot, (_, p) = self._cell.robot, palm_frame(targets, self._tree)
        before, self._height = self._height, p[2]
        away = np.abs(targets - robot.home)[robot.arm_columns].max() > 0.05
        if not away or p[2] < self._lowest - STILL:
            self._low, self._lowest = (targets, p[2]) if away else (None, np.inf)
            return False
        risen = self._lowest + _RISEN < p[2] < before + STILL
        return bool(risen and np.abs(targets - q)[robot.hand_columns].max() > _PRESSING)

    def _deliver(self, targets: Array) -> Iterator[Array]:
        assert self._low is not None
        (R0, p0), (R, p) = (palm_frame(q, self._tree) for q in (self._low, targets))
        middle = R @ R0.T @ (self._middle - p0) + p
        way, lays = self._goal[:3] - middle, self._goal[3] < 0.5
        if lays:
            way[2] = self._middle[2] + _CLEAR - middle[2]
        for leg in (way * [1, 1, way[2] > 0], way * [0, 0, way[2] <= 0]):
            path, _ = carried(targets, middle, leg, self._tree)
            yield from path
            targets = path[-1]
            middle = middle + leg
        if lays:
            opened = arm_and_hand(targets, self._low, self._tree)
            yield from let_go(targets, opened)
            yield from carried(opened, middle, np.array([0.0, 0.0, _AWAY]), self._tree)[0]
