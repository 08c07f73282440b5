"""The way from where the robot stands to the pregrasp: straight, else over a hover, else sampled."""

from collections.abc import Iterator

import numpy as np

from dexgrasp.kinematics.palm_ik import palm_frame
from dexgrasp.motion.cartesian import shift_palm
from dexgrasp.motion.collision import CollisionChecker
from dexgrasp.motion.motion import NoPath, arm_and_hand
from dexgrasp.motion.sampling import TRIES, plan_arm
from dexgrasp_env.arrays import Array

_SPACING = 0.01  # m between points of a straight motion of the palm
_HOVERS = ((0.0, 0.15), (0.0, 0.10), (0.08, 0.08), (0.12, 0.0), (0.08, 0.0), (0.05, 0.12))
"""Where the last straight stretch may begin: m back along the palm's normal, and m up."""
_PALM_ERROR = 0.002  # m


def plan_approach(checker: CollisionChecker, start: Array, pregrasp: Array, tries: int = TRIES) -> Array:
    """Return waypoints (m, n) rad from `start` to `pregrasp`, free by the checker; straight lines join them.

    Args:
        checker: of the scene; both ends are told to it (`CollisionChecker.allow`).
        start: (n,) rad.
        pregrasp: (n,) rad.
        tries: budget of the sampling planner.

    Raises:
        NoPath: with the bodies that are in the way.
    """
    for end in (start, pregrasp):
        checker.allow(end)
    contact = checker.first_contact(pregrasp[None])
    if contact is not None:
        raise NoPath("approach_blocked", f"at the pregrasp, {contact}")
    straight = np.stack([start, pregrasp])
    contact = checker.first_contact(straight)
    if contact is None:
        return straight
    descents = []
    for descent in _descents(checker, pregrasp):
        if checker.free_line(start, descent[0]):
            return np.concatenate([start[None], descent])
        descents.append(descent)
    return _sampled(checker, start, pregrasp, descents, tries, str(contact))


def _descents(checker: CollisionChecker, pregrasp: Array) -> Iterator[Array]:
    """Yield free straight motions of the palm that end at the pregrasp, (m, n) each."""
    R, _ = palm_frame(pregrasp, checker.tree)
    for back, up in _HOVERS:
        shift = np.array([0.0, 0.0, up]) - back * R[:, 0]
        count = int(np.ceil(np.linalg.norm(shift) / _SPACING))
        path, error = shift_palm(pregrasp, checker.tree, np.arange(1, count + 1)[:, None] / count * shift)
        descent = np.concatenate([path[::-1], pregrasp[None]])
        if error < _PALM_ERROR and checker.first_contact(descent) is None:
            yield descent


def _sampled(
    checker: CollisionChecker,
    start: Array,
    pregrasp: Array,
    descents: list[Array],
    tries: int,
    contact: str,
) -> Array:
    opened = arm_and_hand(start, pregrasp, checker.tree)
    checker.allow(opened)
    blocked = checker.first_contact(np.stack([start, opened]))
    if blocked is not None:
        raise NoPath("approach_blocked", f"while the fingers open, {blocked}")
    for descent in [*descents[:2], pregrasp[None]]:
        path = plan_arm(checker, opened, descent[0], tries)
        if path is not None:
            return np.concatenate([start[None], path, descent[1:]])
    raise NoPath("approach_blocked", f"on the straight way {contact}, and no other was found")
