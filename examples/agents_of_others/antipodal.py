"""An antipodal sampler for two pads, as an agent of the suite.

    dexgrasp evaluate --agents examples.agents_of_others.antipodal:Antipodal --robot panda_gripper --objects all20

The recipe is that of ten Pas, Gualtieri, Saenko and Platt (2017), "Grasp pose detection in point clouds", and Mahler et
al. (2017), "Dex-Net 2.0": pairs of points whose normals lie in each other's friction cones, with approaches around the
line between them. Written from the papers; none of their code.
"""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from dexgrasp import Agent, Report
from dexgrasp.agent import BY_CLOUD, Observation
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.to_pose import Pinch, plan_to_pose
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.tasks.control import normalise


class Antipodal(Agent):
    """Closes two pads on the pair of points that opposes best, from the approach nearest to the vertical."""

    env_settings = BY_CLOUD

    def reset(self, observation: Observation, info: dict[str, Any]) -> None:
        """Sample pairs and take the first that the arm carries out."""
        began = time.perf_counter()
        seen = observation["cloud_mask"].astype(bool)
        points, normals = (observation[key][seen].astype(float) for key in ("cloud", "cloud_normals"))
        self.cell: Cell = info["cell"]
        self.start = observation["joint_targets"].astype(float)
        self.report, self.script, self.steps = Report(failure="no_antipodal_pair"), None, 0
        self._plan(points, normals)
        self.report.planning_seconds = time.perf_counter() - began

    def _plan(self, points: np.ndarray, normals: np.ndarray) -> None:
        pinch = Pinch(self.cell)
        for a, b in best_pairs(points, normals, pinch.widest):
            axis, middle, width = b - a, 0.5 * (a + b), float(np.linalg.norm(b - a))
            for palm in palms(pinch, middle, axis / width, width):
                try:
                    self.script = plan_to_pose(palm, pinch.hands(width), points, self.start, self.cell)
                    self.report.failure = None
                    return
                except NoPath as blocked:
                    self.report.failure = blocked.reason

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next set-points."""
        targets = self.start if self.script is None else self.script.at(self.steps)
        self.steps += 1
        return normalise(targets, self.cell.robot).astype(np.float32)


def best_pairs(points: np.ndarray, normals: np.ndarray, widest: float) -> Iterator[np.ndarray]:
    """Yield pairs (2, 3) m in each other's friction cones, best first: opposed, near the middle, above the table."""
    apart = points[None] - points[:, None]
    width = np.linalg.norm(apart, axis=-1)
    line = apart / np.maximum(width, 1e-9)[..., None]
    facing = np.minimum(-(line * normals[:, None]).sum(-1), (line * normals[None]).sum(-1))
    middle = 0.5 * (points[None] + points[:, None])
    off = np.linalg.norm(middle - points.mean(0), axis=-1)
    low = np.minimum(points[:, None, 2], points[None, :, 2]) < 0.015  # m above the table
    score = (
        facing
        - 5.0 * off
        - np.where((facing < 1.0 / np.hypot(1.0, 0.4)) | (width > widest) | low, 9.0, 0.0)  # friction 0.4
    )
    for k in np.argsort(-score, axis=None)[:40]:  # the best
        i, j = np.unravel_index(k, score.shape)
        if score[i, j] > -5.0:
            yield points[[i, j]]


def palms(
    pinch: Pinch, middle: np.ndarray, axis: np.ndarray, width: float
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield poses of the palm that close on a pair: approaches across `axis` (3,), steepest first, both turns."""
    down = np.array([0.0, 0.0, -1.0])
    steep = down - axis * (down @ axis)
    if np.linalg.norm(steep) < 0.2:
        return
    steep /= np.linalg.norm(steep)
    across = np.cross(axis, steep)
    for angle in np.radians([0.0, 30.0, -30.0, 60.0, -60.0]):
        for along in (axis, -axis):
            yield pinch.palm(middle, np.cos(angle) * steep + np.sin(angle) * across, along, width)
