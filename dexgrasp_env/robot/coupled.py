"""Joints that do not move alone: some follow others rigidly, some share a servo by a tendon."""

from dataclasses import dataclass
from typing import Annotated

from dexgrasp_env.valid import Names, Positives, Word, number

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
    """Tendon of one servo: joints of a finger, from the palm out, by the sum of their places times `coefs`.

    Nothing else holds them. In free motion all turn at once; on an object all but the last stand on their lower stops,
    which bear what the tendon cannot. The last has coefficient 1.
    """

    joints: Names
    coefs: Positives
