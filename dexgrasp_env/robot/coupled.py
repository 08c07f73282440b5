"""Joints that do not move alone: some follow others rigidly, some share a servo by a tendon."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.valid import Names, Positives, Word, number

if TYPE_CHECKING:
    from dexgrasp_env.robot.robot import Hand

Number = Annotated[float, number()]


@dataclass(frozen=True)
class Coupling:
    """A joint that stands where another one does: at `ratio` times its place, and `offset` (rad or m) farther."""

    joint: Word
    follows: Word
    ratio: Number = 1.0
    offset: Number = 0.0


@dataclass(frozen=True)
class Tendon:
    """What one servo pulls: joints of a finger, from the palm out, by the sum of their places times `coefs`.

    Nothing else holds them. In free motion all turn at once; on an object all but the last stand on their lower stops,
    which bear what the tendon cannot. The last has coefficient 1.
    """

    joints: Names
    coefs: Positives


def drive_of(hand: "Hand") -> tuple[Array, Array]:
    """Return `Hand.drive`."""
    names, lower = hand.joints.names, hand.joints.lower
    C, c = np.eye(len(names)), np.zeros(len(names))
    for own in hand.couplings:
        row = names.index(own.joint)
        C[row], c[row] = own.ratio * np.eye(len(names))[names.index(own.follows)], own.offset
    for row in (names.index(joint) for tendon in hand.tendons for joint in tendon.joints[:-1]):
        C[row], c[row] = 0.0, lower[row]
    return C, c


def free_of(hand: "Hand") -> tuple[Array, Array]:
    """Return `Hand.free`."""
    C, c = drive_of(hand)
    for tendon in hand.tendons:
        rows, coefs = [hand.joints.names.index(joint) for joint in tendon.joints], np.array(tendon.coefs)
        share = np.outer(coefs, coefs) / (coefs @ coefs)
        C[np.ix_(rows, rows)] = share
        c[rows] = (np.eye(len(rows)) - share) @ np.array(hand.joints.lower)[rows]
    return C, c
