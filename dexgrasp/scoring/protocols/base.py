"""What every protocol for grasps of a floating hand has: physics, limits on the object's motion, a verdict."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dexgrasp.scoring.candidate import Candidate, HandStage
from dexgrasp.scoring.scene import FloatingScene, Physics, displacement
from dexgrasp_env.arrays import Array

AXES: dict[str, Array] = {
    f"{sign}{axis}": (1.0 if sign == "+" else -1.0) * np.eye(3)["xyz".index(axis)]
    for axis in "xyz"
    for sign in "-+"
}
"""The six directions of the world in DexGraspBench's order."""
GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Verdict:
    """What came of it.

    Attributes:
        success: by the protocol.
        score: from 0 to 1: the share of draws that succeeded where there are several, else 0 or 1.
        reason: why it failed, one of a countable few; None for successes.
        sentence: the same in words.
        moved_m: of the object against where it should be, when it was judged.
        turned_rad: likewise.
    """

    success: bool
    score: float
    reason: str | None = None
    sentence: str = "held"
    moved_m: float = 0.0
    turned_rad: float = 0.0


class GraspProtocol(ABC):
    """One way of scoring a grasp.

    Attributes:
        name: on the command line.
        summary: one line for people.
        physics: friction, solver, servo gain.
        most_moved: m.
        most_turned: rad.
        density: of the object, kg/m^3; or its `fixed_mass`, kg.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    physics: ClassVar[Physics]
    most_moved: ClassVar[float]
    most_turned: ClassVar[float]
    density: ClassVar[float] = 0.0
    fixed_mass: ClassVar[float | None] = None

    def mass(self, candidate: Candidate) -> float:
        """Return the mass of the object, kg."""
        return (
            self.density * float(candidate.object.mesh.volume) if self.fixed_mass is None else self.fixed_mass
        )

    @abstractmethod
    def judge(self, candidate: Candidate, seed: int) -> Verdict:
        """Score a grasp; `seed` is of the protocol's own draws."""

    def _scene(self, candidate: Candidate) -> FloatingScene:
        """Return the scene, in the pregrasp."""
        scene = FloatingScene(candidate, self.physics, self.mass(candidate))
        scene.reset(candidate.pregrasp)
        return scene

    def _close(self, scene: FloatingScene, to_grasp: float, to_squeeze: float) -> HandStage:
        """Close from the pregrasp, which the scene is in, and return the squeeze (times in s)."""
        candidate, squeeze = scene.candidate, scene.candidate.squeeze_for(scene.servo_kp)
        scene.move(candidate.pregrasp, candidate.grasp, to_grasp)
        scene.move(candidate.grasp, squeeze, to_squeeze)
        return squeeze

    def _verdict(self, before: Array, after: Array, when: str) -> Verdict:
        """Judge the object's pose `after` against where it should be."""
        moved, turned = displacement(before, after)
        if moved < self.most_moved and turned < self.most_turned:
            return Verdict(True, 1.0, moved_m=moved, turned_rad=turned)
        reason = "moved" if moved >= self.most_moved else "turned"
        how = f"{100 * moved:.1f} cm" if reason == "moved" else f"{math.degrees(turned):.0f} deg"
        return Verdict(False, 0.0, reason, f"{reason} by {how} {when}", moved, turned)
