"""D(R,O) Grasp (ICRA 2025): six slow pushes at a friction of 3."""

import math

from dexgrasp.scoring.candidate import Candidate
from dexgrasp.scoring.protocols.base import AXES, GraspProtocol, Verdict
from dexgrasp.scoring.scene import Physics


class Dro(GraspProtocol):
    """`dro`: friction 3 and an acceleration of 0.5 m/s2 along each of six directions, 1 s each, one after the other."""

    name = "dro"
    summary = "D(R,O): mu 3, 0.5 m/s2 x 6 x 1 s, at most 2 cm; for comparison only: with mu 3 almost any touch holds"
    physics = Physics(friction=(3.0, 0.02), servo_kp=10.0)
    most_moved = 0.02
    most_turned = math.inf
    density = 500.0
    _acceleration = 0.5  # m/s^2

    def judge(self, candidate: Candidate, seed: int) -> Verdict:
        """Close, then push; judged at the end against where the closed hand had it."""
        scene = self._scene(candidate)
        self._close(scene, 0.5, 0.5)
        start = scene.pose()
        for name in ("+x", "+y", "+z", "-x", "-y", "-z"):
            scene.push(self._acceleration * scene.mass * AXES[name])
            scene.run(1.0)
        return self._verdict(start, scene.pose(), "under the six pushes")
