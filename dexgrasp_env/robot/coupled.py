"""Joints that do not move alone: some follow others rigidly, some share a servo by a tendon."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.valid import NAMES, Rule, Word, number, read, several

Names = Annotated[tuple[str, ...], NAMES]
Number = Annotated[float, number()]
Positives = Annotated[tuple[float, ...], several(number(gt=0))]


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


def _couplings(value: Any) -> tuple[Coupling, ...]:
    return tuple(read(Coupling, coupling, "coupling") for coupling in value)


def _tendons(value: Any) -> tuple[Tendon, ...]:
    return tuple(read(Tendon, tendon, "tendon") for tendon in value)


COUPLINGS = Rule("a list of couplings", _couplings)
TENDONS = Rule("a list of tendons", _tendons)


def drive_of(
    names: Names, lower: tuple[float, ...], couplings: tuple[Coupling, ...], tendons: tuple[Tendon, ...]
) -> tuple[Array, Array]:
    """Return `Hand.drive` of joints with their lower stops, rad."""
    C, c = np.eye(len(names)), np.zeros(len(names))
    for own in couplings:
        row = names.index(own.joint)
        C[row], c[row] = own.ratio * np.eye(len(names))[names.index(own.follows)], own.offset
    for row in (names.index(joint) for tendon in tendons for joint in tendon.joints[:-1]):
        C[row], c[row] = 0.0, lower[row]
    return C, c


def free_of(
    names: Names, lower: tuple[float, ...], couplings: tuple[Coupling, ...], tendons: tuple[Tendon, ...]
) -> tuple[Array, Array]:
    """Return `Hand.free` of joints with their lower stops, rad."""
    C, c = drive_of(names, lower, couplings, tendons)
    for tendon in tendons:
        rows, coefs = [names.index(joint) for joint in tendon.joints], np.array(tendon.coefs)
        share = np.outer(coefs, coefs) / (coefs @ coefs)
        C[np.ix_(rows, rows)] = share
        c[rows] = (np.eye(len(rows)) - share) @ np.array(lower)[rows]
    return C, c
