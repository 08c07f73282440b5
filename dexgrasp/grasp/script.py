"""What is executed of a grasp: set-points for every control step, phase by phase."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dexgrasp_env.arrays import Array


@dataclass(frozen=True)
class ActionScript:
    """Set-points of an episode.

    Attributes:
        targets: (T, n) rad, one a control step.
        phases: names and first steps: approach, close, squeeze, lift, hold.
        start: (n,) rad, set-points before the first step.
    """

    targets: Array
    phases: tuple[tuple[str, int], ...]
    start: Array

    @classmethod
    def of(cls, pieces: Mapping[str, Array], start: Array) -> "ActionScript":
        """Put phases (k, n) rad together, by their names in order."""
        first = np.cumsum([0, *map(len, pieces.values())])[:-1].tolist()
        return cls(np.concatenate(list(pieces.values())), tuple(zip(pieces, first, strict=True)), start)

    def at(self, step: int) -> Array:
        """Return the set-points (n,) rad of a step from 0 on; the last are held."""
        return np.asarray(self.targets[min(step, len(self.targets) - 1)])

    def phase(self, step: int) -> str:
        """Return the name of the phase that a step belongs to."""
        return [name for name, first in self.phases if first <= step][-1]
