"""The road of planners whose grasp is where two pads close: from an observation to set-points."""

import time
from abc import abstractmethod
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from dexgrasp import Agent, Report
from dexgrasp.agent import BY_CLOUD, Observation
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.to_pose import Pinch, plan_to_pose
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.tasks.control import normalise


class Pads(NamedTuple):
    """A grasp: the middle (3,) m, approach (3,) from the palm to it, axis (3,) from pad to pad, width m between."""

    middle: np.ndarray
    approach: np.ndarray
    axis: np.ndarray
    width: float


class TwoPadAgent(Agent):
    """Carries out the first grasp of `grasps` that the arm can."""

    env_settings = BY_CLOUD

    @abstractmethod
    def grasps(
        self, points: np.ndarray, normals: np.ndarray, plane: np.ndarray, pinch: Pinch
    ) -> Iterator[Pads]:
        """Yield grasps, best first, of a cloud (N, 3) m with normals (N, 3), on a table of normal (3,) and offset m."""

    def reset(self, observation: Observation, info: dict[str, Any]) -> None:
        """Plan."""
        began = time.perf_counter()
        seen = observation["cloud_mask"].astype(bool)
        points, normals = (observation[key][seen].astype(float) for key in ("cloud", "cloud_normals"))
        self.cell: Cell = info["cell"]
        self.start = observation["joint_targets"].astype(float)
        self.report, self.script, self.steps = Report(failure="no_pair_of_points"), None, 0
        pinch = Pinch(self.cell)
        for pads in self.grasps(points, normals, observation["table_plane"][:4], pinch):
            palm = pinch.palm(pads.middle, pads.approach, pads.axis, pads.width)
            try:
                self.script = plan_to_pose(palm, pinch.hands(pads.width), points, self.start, self.cell)
                self.report.failure = None
                break
            except NoPath as blocked:
                self.report.failure = blocked.reason
        self.report.planning_seconds = time.perf_counter() - began

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next set-points."""
        targets = self.start if self.script is None else self.script.at(self.steps)
        self.steps += 1
        return normalise(targets, self.cell.robot).astype(np.float32)
