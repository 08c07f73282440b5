"""Contact models: which parts a contact force has, and which of them friction bounds.

A model is a value that plain and compiled code take alike: compiled code is made for the type of the model, so what a
model lacks is not even compiled. A further model is a further class here, with its planes in `margin_lp` and
`robust_push`.
"""

from typing import NamedTuple


class HardFinger(NamedTuple):
    """A point contact with friction: three force components, and free to turn about its normal.

    Attributes:
        parts: zeros, one a part of the force; compiled code knows the length of a tuple.
        torsion: none.
    """

    parts: tuple[int, ...] = (0, 0, 0)
    torsion: None = None


class SoftFinger(NamedTuple):
    """A contact patch: three force components, and a torque about the normal over the radius `torsion`.

    So divided the torque is in newtons, and one friction coefficient bounds tangential force and torque together
    (an elliptic limit surface).

    Attributes:
        parts: zeros, one a part of the force.
        torsion: m, torsional friction over sliding friction.
    """

    parts: tuple[int, ...]
    torsion: float


ContactModel = HardFinger | SoftFinger


def contact_model(torsion: float) -> ContactModel:
    """Return the model of fingertips of a radius of torsional friction, m; 0: they turn freely."""
    return SoftFinger((0, 0, 0, 0), float(torsion)) if torsion else HardFinger()
