"""An antipodal sampler for two pads, as an agent of the suite.

    dexgrasp evaluate --agents examples.agents_of_others.antipodal:Antipodal --robot panda_gripper --objects all20

The recipe is that of ten Pas, Gualtieri, Saenko and Platt (2017), "Grasp pose detection in point clouds", and Mahler et
al. (2017), "Dex-Net 2.0": pairs of points whose normals lie in each other's friction cones, with approaches around the
line between them. Written from the papers; none of their code.
"""

from collections.abc import Iterator

import numpy as np

from dexgrasp.motion.to_pose import Pinch

from .two_pads import Pads, TwoPadAgent


class Antipodal(TwoPadAgent):
    """Closes two pads on the pair of points that opposes best, from the approach nearest to the vertical."""

    def grasps(
        self, points: np.ndarray, normals: np.ndarray, plane: np.ndarray, pinch: Pinch
    ) -> Iterator[Pads]:
        """Yield the best pairs, each from several approaches."""
        for a, b in best_pairs(points, normals, pinch.widest):
            width = float(np.linalg.norm(b - a))
            yield from approaches(0.5 * (a + b), (b - a) / width, width)


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


def approaches(middle: np.ndarray, axis: np.ndarray, width: float) -> Iterator[Pads]:
    """Yield grasps that close along `axis` (3,): approaches across it, steepest first, both turns."""
    down = np.array([0.0, 0.0, -1.0])
    steep = down - axis * (down @ axis)
    if np.linalg.norm(steep) < 0.2:
        return
    steep /= np.linalg.norm(steep)
    across = np.cross(axis, steep)
    for angle in np.radians([0.0, 30.0, -30.0, 60.0, -60.0]):
        for along in (axis, -axis):
            yield Pads(middle, np.cos(angle) * steep + np.sin(angle) * across, along, width)
