"""Setting aside what the hand has taken: it is lifted, carried to its place and let go of."""

from typing import NamedTuple

import numpy as np

from dexgrasp.motion.carried import let_go
from dexgrasp.motion.guarded import GuardedGrasp
from dexgrasp.motion.motion import Played, arm_and_hand
from dexgrasp_env.arrays import Array


class WayAside(NamedTuple):
    """What follows the lift."""

    there: Array  # (m, n) rad, set-points with the object in the hand, one a control step
    away: Array  # (k, n) rad, the same of the open hand


class SettingAside(Played):
    """Carries what was taken hold of to its place; nothing is felt. It is done when the hand has left the object."""

    def __init__(self, held: GuardedGrasp, way: WayAside) -> None:
        """Prepare.

        Args:
            held: that is done.
            way: from the end of its lift.
        """
        arm = held.tree.arm
        rows = np.concatenate([held.script.phases["lift"], way.there])
        rows[:, arm:] = held.targets[arm:]
        opened = arm_and_hand(rows[-1], way.away[0], held.tree)
        super().__init__(np.concatenate([rows, let_go(rows[-1], opened), way.away]), held.tree)
