"""What is executed of a grasp: set-points for every control step, phase by phase."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.tasks.control import normalise


@dataclass(frozen=True)
class ActionScript:
    """Set-points of an episode.

    Attributes:
        targets: (T, 23) rad, one a control step.
        phases: names and first steps: approach, close, squeeze, lift, hold.
        start: (23,) rad, set-points before the first step.
    """

    targets: Array
    phases: tuple[tuple[str, int], ...]
    start: Array

    def action(self, step: int) -> NDArray[np.float32]:
        """Return the `joint_position` action (23,) of a step from 0 on; the last one is held."""
        return normalise(self.targets[min(step, len(self.targets) - 1)]).astype(np.float32)

    def phase(self, step: int) -> str:
        """Return the name of the phase that a step belongs to."""
        return [name for name, first in self.phases if first <= step][-1]
