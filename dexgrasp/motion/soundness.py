"""What `verify` would refuse of a script, refused before: a way that bends, a lift in which the hand meets itself."""

import numpy as np

from dexgrasp.grasp.path import bend
from dexgrasp.grasp.script import ActionScript
from dexgrasp.kinematics.tree import RobotTree
from dexgrasp.motion.collision import CollisionChecker
from dexgrasp.motion.motion import NoPath

_BEND = 2.3e-3  # rad that a set-point of the approach may stand out of its neighbours' plane; `verify` allows 2.5e-3


def check_way(script: ActionScript, tree: RobotTree) -> None:
    """Check approach and lift of a script, the object apart.

    Raises:
        NoPath: `approach_bends`, or `lift_blocked` with what is in the way.
    """
    first = dict(script.phases)
    bent = bend(np.concatenate([script.start[None], script.targets[: first["close"]]]))
    if bent > _BEND:
        raise NoPath("approach_bends", f"a set-point stands out by {1000 * bent:.1f} mrad")
    lift = script.targets[first["lift"] - 1 : first["hold"]]
    contact = CollisionChecker(tree, None, 0.0).first_contact(lift)
    if contact is not None:
        raise NoPath("lift_blocked", str(contact))
