"""Grasps of the box around an object, from above, as an agent of the suite, with any hand that can pinch.

    dexgrasp evaluate --agents examples.agents_of_others.box_grasp:BoxGrasp --robot panda_gripper --objects all20

The recipe for boxes of Miller, Knoop, Christensen and Allen (2003), "Automatic grasp planning using shape primitives",
which M. Ferguson's ROS package `simple_grasping` (BSD) applies to the box around a segmented cloud: close across two
opposite sides, nearest to the middle first. Written from the paper; none of their code.
"""

from collections.abc import Iterator

import numpy as np

from dexgrasp.motion.to_pose import Pinch

from .two_pads import Pads, TwoPadAgent


class BoxGrasp(TwoPadAgent):
    """Closes across a side of the upright box along the cloud's principal axes, the shorter side first."""

    def grasps(
        self, points: np.ndarray, normals: np.ndarray, plane: np.ndarray, pinch: Pinch
    ) -> Iterator[Pads]:
        """Yield grasps from above: both pairs of sides, three places along each, two depths, both turns."""
        centre, top = points.mean(0), float(points[:, 2].max())
        axes = np.linalg.eigh(np.cov(points[:, :2].T))[1].T
        along = (points[:, :2] - centre[:2]) @ axes.T
        low, high = along.min(0), along.max(0)
        for across in np.argsort(high - low):
            width, other = float(high[across] - low[across]), 1 - across
            if width > pinch.widest:
                continue
            for place in (0.5, 0.35, 0.65):
                for deep in (0.03, 0.015):  # m below the top
                    middle = np.append(centre[:2], max(top - deep, 0.015))  # and above the table
                    middle[:2] += axes[across] * 0.5 * (low[across] + high[across])
                    middle[:2] += axes[other] * (low[other] + place * (high[other] - low[other]))
                    for sign in (1.0, -1.0):
                        yield Pads(
                            middle, np.array([0.0, 0.0, -1.0]), np.append(sign * axes[across], 0.0), width
                        )
