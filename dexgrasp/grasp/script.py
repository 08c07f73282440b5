"""What is executed of a grasp: set-points for every control step, phase by phase."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dexgrasp_env.arrays import Array


@dataclass(frozen=True)
class ActionScript:
    """Set-points of an episode.

    Attributes:
        phases: (k, n) rad of each phase, one a control step, by its name: approach, close, squeeze, lift, hold.
        start: (n,) rad, set-points before the first step.
    """

    phases: Mapping[str, Array]
    start: Array

    @cached_property
    def targets(self) -> Array:
        """Set-points (T, n) rad of all phases."""
        return np.concatenate(list(self.phases.values()))

    def way(self, phase: str) -> Array:
        """Return the set-points (k + 1, n) rad of a phase, from those before it on."""
        before = dict(zip(self.phases, [self.start[None], *self.phases.values()], strict=False))
        return np.concatenate([before[phase][-1:], self.phases[phase]])

    def at(self, step: int) -> Array:
        """Return the set-points (n,) rad of a step from 0 on; the last are held."""
        return self.targets[min(step, len(self.targets) - 1)]
