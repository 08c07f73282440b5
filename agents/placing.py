"""Placing: another agent's grasps, carried to their goals, and let go of where the objects are to lie."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from dexgrasp.agent import Agent, Info, Observation, Report, cell_of
from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.neighbours import neighbours_of, without_splinters
from dexgrasp.geometry.target import PART_FACES
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.motion.carried import STILL, carried, let_go, plan_retreat
from dexgrasp.motion.motion import NoPath, Played, arm_and_hand
from dexgrasp_env.arrays import Array, Single, grid, middle
from dexgrasp_env.perception.pipeline import COUNT
from dexgrasp_env.perception.scene import ObjectCloud, Scene
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.tasks.constants import AROUND_POINTS
from dexgrasp_env.tasks.control import normalise
from dexgrasp_env.tasks.features import entry

_ROOM = 0.05  # m between things and walls of the tray, for fingers
_BESIDE = 0.02  # m beside the tray, where things count as in it


class PlacingAgent(Agent):
    """Carries what an agent of `joint_position` has lifted to its goal, and lets go of it there where the goal says so.

    The middle of the object is taken from the first cloud, and to move as the palm does.
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

    def reset(self, observation: Observation, info: Info) -> None:
        """Plan with the agent, and note the place of the object and its goal."""
        self.agent.reset(observation, info)
        points = Scene.of_observation(observation, info).target.points
        self._middle = middle(points) if len(points) else np.zeros(3)
        self._goal = entry(observation, "desired_goal")
        self._cell = cell_of(info, default_cell())
        self._tree = robot_tree(self._cell)
        self._low: Array | None = None  # set-points when the hand came down, still open
        self._lowest = self._height = np.inf  # m, of the palm then, and a step ago
        self._way: Iterator[Array] = iter(())
        self._last: Array | None = None

    def act(self, observation: Observation) -> Single:
        """Return the agent's action, or from the end of its lift on the next on the way to the goal."""
        targets = entry(observation, "joint_targets")
        if self._last is None and self._lifted(targets, entry(observation, "joint_positions")):
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
        # The palm has come up 8 cm; a joint of a hand that holds something lags 0.02 rad behind its set-point.
        risen = self._lowest + 0.08 < p[2] < before + STILL
        return bool(risen and np.abs(targets - q)[robot.hand_columns].max() > 0.02)

    def _deliver(self, targets: Array) -> Iterator[Array]:
        assert self._low is not None
        (R0, p0), (R, p) = (palm_frame(q, self._tree) for q in (self._low, targets))
        middle = R @ R0.T @ (self._middle - p0) + p
        rows, lays = self._carry(targets, middle)
        yield from rows
        if lays:
            opened = arm_and_hand(rows[-1], self._low, self._tree)
            yield from let_go(rows[-1], opened)
            up = np.array([0.0, 0.0, 0.10])  # m
            yield from carried(opened, middle, up, self._tree)[0]

    def _carry(self, targets: Array, middle: Array) -> tuple[Array, bool]:
        """Return set-points (m, n) rad that take the object from where its middle is; whether it is let go of then."""
        way, lays = self._goal[:3] - middle, bool(self._goal[3] < 0.5)
        if lays:
            way[2] = self._middle[2] + 0.002 - middle[2]  # m above the table
        return self._along(targets, middle, way * [1, 1, way[2] > 0], way * [0, 0, way[2] <= 0])[0], lays

    def _along(self, targets: Array, middle: Array, *legs: Array) -> tuple[Array, float]:
        """Return set-points (m, n) rad that take an object along legs (3,) m, and the largest error of the palm, m."""
        rows, worst = [], 0.0
        for leg in legs:
            path, error = carried(targets, middle, leg, self._tree)
            targets, middle, worst = path[-1], middle + leg, max(worst, error)
            rows.append(path)
        return np.concatenate(rows), worst


class ClearingAgent(PlacingAgent):
    """Clears the table into the tray: has an agent grasp one object after the other, and carries each there.

    From home it looks at the table, and names the agent one thing as the one that is meant until it has a plan: the
    most isolated first, what it failed at last. What is in the tray no camera sees: it is remembered.
    """

    def __init__(self, agent: Agent) -> None:
        super().__init__(agent)
        self.env_settings = {**self.env_settings, "observe": "clear"}  # type: ignore[misc]  # of the instance
        self._idle, self._delivered, self._steps = True, False, 0

    def reset(self, observation: Observation, info: Info) -> None:
        """Look at the table for the first time; the agent is told of no later looks, which are not its own."""
        self._info = {key: value for key, value in info.items() if key != "observe"}
        self._tray = np.asarray(info["tray"])
        self._full = np.zeros((0, 4))  # m, x, y, radius and top of what lies in the tray
        self._missed: list[Array] = []  # m, where things stood that were not carried off
        self._home: Played | None = None
        self._start(observation)

    def act(self, observation: Observation) -> Single:
        """Return the agent's action, the next on the way to the tray, or home, where the next round begins."""
        targets = entry(observation, "joint_targets")
        if self._home is not None and self._home.done:
            self._home = None
            self._start(observation)
        if self._idle:
            return normalise(targets, self._tree).astype(np.float32)
        # 260 control steps are enough to lift an object, carry it to the tray and let go of it.
        if self._home is None and (self._delivered or self._steps > 260):
            if not self._delivered:
                self._missed.append(self._middle[:2])
            self._home = self._way_home(targets)
            self._idle = self._home is None
        self._steps += 1
        if self._home is not None:
            return self._home.action(observation["joint_positions"])
        return super().act(observation)

    def _start(self, observation: Observation) -> None:
        """Begin a round: choose a thing for which the agent has a plan; there is no more to do where it has none."""
        scene = Scene.of_observation(observation, self._info)
        # What stands out of the tray is cut off where cameras see no farther.
        outside = self._tray[0, :2] - _BESIDE
        things = [
            one
            for one in (scene.target, *scene.neighbours)
            if len(one) >= 20 and not (one.points[:, :2] > outside).all(axis=1).any()
        ]
        self._steps, self._delivered, self._idle = 0, False, True
        self._cell = cell_of(self._info, default_cell())
        self._tree = robot_tree(self._cell)
        for k in self._order(things):
            others = tuple(things[:k] + things[k + 1 :])
            meant = replace(scene, target=things[k], neighbours=others).as_observation(COUNT, AROUND_POINTS)
            super().reset({**observation, **meant, "desired_goal": np.zeros(4)}, self._info)
            if self.report.failure is None:
                self._idle, self._size = False, np.ptp(things[k].points, axis=0)
                self._over = max([0.0, *(one.points[:, 2].max() for one in others)])
                self._around = neighbours_of(
                    without_splinters(replace(scene, target=things[k], neighbours=others))
                )
                return

    def _order(self, things: list[ObjectCloud]) -> list[int]:
        """Return things in the order in which they are tried."""

        def rank(k: int) -> tuple[int, float]:
            """Return how often one was missed there, and how near, less than 0, the next thing is."""
            at = middle(things[k].points)
            others = [np.linalg.norm(one.points - at, axis=1).min() for one in things[:k] + things[k + 1 :]]
            # What stands within 4 cm of where one was missed is taken for that.
            missed = [place for place in self._missed if np.linalg.norm(at[:2] - place) < 0.04]
            return len(missed), -float(min(others, default=np.inf))

        return sorted(range(len(things)), key=rank)

    def _carry(self, targets: Array, middle: Array) -> tuple[Array, bool]:
        """Return the way up, over to the least full place of the tray that the arm reaches, and down."""
        radius, inside = 0.5 * float(np.linalg.norm(self._size[:2])), self._tray[:, :2]
        low, high = inside + np.minimum(radius + _ROOM, 0.5 * np.ptp(inside, axis=0)) * [[1.0], [-1.0]]
        places = grid(*(np.linspace(*ends, 9) for ends in zip(low, high, strict=True)))  # along a side
        gaps = np.linalg.norm(places[:, None] - self._full[:, :2], axis=2) - self._full[:, 2] - radius
        tops = np.where(gaps < 0.0, self._full[:, 3], 0.0).max(axis=1, initial=0.0)
        order = np.lexsort((np.linalg.norm(places, axis=1), -gaps.min(axis=1, initial=_ROOM), tops))
        bottom = middle[2] - 0.5 * self._size[2]
        up = max(0.0, self._over, self._full_to) + 0.03 - bottom  # m over what stands and lies on the way
        found = None
        allowed = 0.005  # m that the palm may be off its way
        for rise, k in product((up, 0.5 * up), order):
            # It drops 2 cm into the tray.
            over, down = [*(places[k] - middle[:2]), 0.0], [0.0, 0.0, tops[k] + 0.02 - bottom - rise]
            rows, error = self._along(targets, middle, *np.array([[0.0, 0.0, rise], over, down]))
            if found is None or error < allowed:
                found = rows, k
            if error < allowed:
                break
        assert found is not None  # there are places
        rows, k = found
        self._full = np.vstack([self._full, [*places[k], radius, tops[k] + self._size[2]]])
        return rows, True

    @property
    def _full_to(self) -> float:
        """Height, m, of the tray with what lies in it."""
        return float(self._full[:, 3].max(initial=self._tray[1, 2]))

    def _deliver(self, targets: Array) -> Iterator[Array]:
        yield from super()._deliver(targets)
        self._delivered = True

    def _way_home(self, targets: Array) -> Played | None:
        """Return the way home past what stands on the table; None where there is none."""
        low, high = self._tray
        tray = grid(*np.transpose([low, [*high[:2], self._full_to]]))
        solids = [tray, *(part for thing in self._around for part in thing)]
        parts = [ConvexDistance.from_points(solid, PART_FACES) for solid in solids]
        for obstacle in (ConvexDistance.union(parts), None):
            with suppress(NoPath):
                return plan_retreat(targets, self._cell, obstacle)
        return None
