"""Internal forces of a grasp: the squeeze that bears the largest push.

All forces at contacts that balance gravity are f = s hold + N x: `hold` bears the weight, s is the share of it that is
borne, and x are the internal forces, of three points those along the sides of their triangle. A push, any force through
the centre of mass, is answered by the forces of least norm. The firmest squeeze is the x with s = 1 whose forces stay
within their cones under a push of D weights in any direction, D as large as can be, within joint torque limits; where
even D = 0 cannot be had, that with the largest s.

Of a push beyond `RESERVED` weights the joints must be able to answer the excess: those that squeeze with all they have
give way under it long before the cones do.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp.mechanics.contacts import Contacts, Shape, contiguous, shape_of
from dexgrasp.mechanics.equilibrium import FLAT, answers_to_pushes, internal_forces
from dexgrasp.mechanics.margin_lp import (
    Programme,
    add_presses,
    add_torques,
    begin,
    empty_programme,
    maximise,
    set_cones,
)
from dexgrasp.mechanics.robust_push import borne_pushes
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import leaf, njit

RESERVED = 1.0
"""Weights: what a push has beyond this, the joints keep the torque to answer. What is heavy is squeezed with all."""
_FACES = 12  # planes of each cone at first
_ROUNDS = 8  # of further planes; two or three are enough as a rule


class Squeeze(NamedTuple):
    """Forces of a squeeze, and what they bear."""

    forces: Array
    """(N, c) N on the object, world axes."""
    push: float
    """D: largest force in any direction that they bear, in weights; 0 where they bear gravity alone, or less."""
    share: float
    """Of the weight that they balance: 1, or less where the joints or the cones allow no more; 0: nothing holds."""

    @property
    def load(self) -> float:
        """Of the weight, how much is borne: 1 + D, or the share that is balanced."""
        return self.share + self.push


class Aim(NamedTuple):
    """Parameters of the search for a squeeze."""

    press: float  # N, least of each contact
    reserved: float  # weights, see `RESERVED`
    most: float  # weights: a push beyond which nothing is gained
    faces: int  # planes of each cone at first
    rounds: int  # of further planes


@njit
def empty_room(shape: Shape, joints: int) -> Programme:
    """Return room for squeezes of contacts that `joints` joints press; estimates are made by the thousand."""
    rows = shape.contacts * (_FACES + 1 + _ROUNDS) + 4 * shape.contacts * joints
    return empty_programme(shape, shape.internal + 1, rows)


@njit
def squeeze_kernel(contacts: Contacts, aim: Aim, p: Programme) -> tuple[float, float]:
    """Return the push D of the firmest squeeze, in weights, and the share of gravity that it balances; no checks.

    Its forces are those of the programme `p`. Without rounds of further planes D is a little too high.
    """
    if not internal_forces(contacts.points, contacts.normals, contacts.model.torsion, p.span) > FLAT:
        return 0.0, 0.0
    set_cones(p, contacts.normals, contacts.friction)
    tolerance = 5e-5 * answers_to_pushes(contacts, p.answers, p.fixed)  # of the weight
    p.span[:, :, -1] = 0.0
    if _solve(p, contacts, aim, aim.most, tolerance) and p.lp.z[-1] >= 0.0:
        return p.lp.z[-1], 1.0
    p.answers[:] = 0.0
    p.span[:, :, -1] = p.fixed
    p.fixed[:] = 0.0
    return 0.0, max(p.lp.z[-1], 0.0) if _solve(p, contacts, aim, 1.0, tolerance) else 0.0


@leaf
def _solve(p: Programme, contacts: Contacts, aim: Aim, most: float, tolerance: float) -> bool:
    begin(p, most, aim.faces)
    if aim.press > 0.0:
        add_presses(p, contacts.normals, aim.press)
    add_torques(p, contacts, aim.reserved)
    return maximise(p, aim.rounds, tolerance, -np.inf)


@njit
def squeeze_estimate(contacts: Contacts, most: float, room: Programme) -> float:
    """Return the load of the firmest squeeze, mostly a tenth too high: cones have eight planes, and none is added."""
    push, share = squeeze_kernel(contacts, Aim(0.0, np.inf, most, 8, 0), room)
    return push + share


@njit
def _firmest(contacts: Contacts, shape: Shape, aim: Aim) -> tuple[Array, float, float]:
    p = empty_room(shape, contacts.torque_limits.shape[0])
    push, share = squeeze_kernel(contacts, aim, p)
    if share == 0.0:
        p.forces[:] = 0.0
    elif share == 1.0:
        push = max(min(push, borne_pushes(p.cones, p.answers, p.forces)), 0.0)
    return p.forces, push, share


def firmest_squeeze(contacts: Contacts, press: float = 0.0, most: float = 10.0) -> Squeeze:
    """Return the forces of contacts that bear the largest push in any direction.

    Args:
        contacts: two soft fingers, or three or more.
        press: N that each contact presses with at least.
        most: push, in weights, beyond which the squeeze need not be firmer.
    """
    aim = Aim(float(press), RESERVED, float(most), _FACES, _ROUNDS)
    return Squeeze(*_firmest(contiguous(contacts), shape_of(len(contacts.points), contacts.model), aim))
