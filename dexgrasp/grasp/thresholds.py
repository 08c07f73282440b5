"""The thresholds that `verify` holds every grasp to. Frozen: tuning the planner does not move its judge."""

from dataclasses import dataclass, replace
from typing import Annotated

from dexgrasp.grasp.field_types import Number, Positive
from dexgrasp_env.robot.robot import Hand
from dexgrasp_env.valid import number, pair

Range = Annotated[tuple[float, float], pair(number())]

FRICTION_SHARE = 5.0 / 7.0
"""Of the true friction coefficient that a plan may count on."""
HOLD_SHARE = 6.0 / 7.0
"""Of the true friction coefficient that the holding forces may use."""

CONTACT_INSIDE = 0.008
"""m that a contact may lie below the true surface of the object that a file names: its finger meets it early."""
TIP_SHORT = 0.006
"""m that a tip at the grasp may be short of that surface: closing, which is guarded, takes it there."""
PRESSED = 0.002
"""m that surface where nothing may touch may lie in a planned tip, which goes deeper than one that presses."""
HULL_OUTSIDE, OBJECT_OUTSIDE = 0.03, 0.055
"""m that the planned hull may stand out of the object's, and the object's out of it: of one view much is guessed."""
OVERLAP = 0.55
"""Least share of the volume of both hulls that they have in common."""
TOLD_MASS, TOLD_CENTRE = 0.01, 0.002
"""Share and m that a mass and a centre that the planner was told may differ from the object's."""


@dataclass(frozen=True)
class Thresholds:
    """Limits of every certified grasp; lengths in m, angles in rad, forces in N.

    Attributes:
        friction: coefficient that closure is proved with.
        friction_hold: coefficient in whose cones the forces stay.
        distance: range of the tip's depth: distance of its centre from the surface, less `tip_radius`.
        tip_radius: effective radius of the compliant fingertip.
        closure_margin: least min-weight margin.
        clearance: least clearance of hand and arm to object (grasping tips apart), table and themselves.
        tip_cosine: least cosine of a tip's axis to the inward normal: the back of a tip cannot press.
        pad_cosine: least cosine of a pad's direction to the inward normal.
        joint_margin: distance of every grasping joint from its limits.
        contact_height: least height of a contact above the table; of low objects see `lowest_contact`.
        least_press: least pressing force of a contact.
        torque_share: share of the joint torque limits that the forces may use.
    """

    friction: Positive = 0.5
    friction_hold: Positive = 0.6
    distance: Range = (-0.0068, -0.0032)
    tip_radius: Number = 0.014
    closure_margin: Number = 0.15
    clearance: Number = 0.001
    tip_cosine: Number = 0.10
    pad_cosine: Number = -0.25
    joint_margin: Number = 0.01
    contact_height: Number = 0.015
    least_press: Number = 2.5
    torque_share: Number = 0.95

    def lowest_contact(self, top: float) -> float:
        """Return the least height of a contact, m, on an object that is `top` m high.

        That tips and links stay clear of the table is judged apart, by their shapes: a tip beside a low object meets
        its upper edge at whatever height that has.
        """
        return min(self.contact_height, 0.5 * top)

    def is_low(self, top: float) -> bool:
        """Return True for an object `top` m high, lower than two tips' radii or so, whose contacts may be lower."""
        return self.lowest_contact(top) < self.contact_height

    def off_table(self, top: float) -> float:
        """Return the least clearance of the hand from the table, m, at an object `top` m high.

        Beside a low object tips may touch the table: hands are soft, and level forces need low tips.
        """
        return 0.0 if self.is_low(top) else self.clearance

    def looser(self, hand: Hand) -> list[str]:
        """Return the names of those that ask less than the frozen ones; the tip radius may be the hand's alone."""
        ours = frozen_for(hand)
        found = {
            "distance": self.distance[0] < ours.distance[0] or self.distance[1] > ours.distance[1],
            "tip_radius": self.tip_radius != hand.tip_radius,
        }
        found |= {name: getattr(self, name) > getattr(ours, name) for name in _AT_MOST}
        found |= {name: getattr(self, name) < getattr(ours, name) for name in _AT_LEAST}
        return [name for name, worse in found.items() if worse]


_AT_MOST = ("friction", "friction_hold", "torque_share")
_AT_LEAST = (
    "closure_margin", "clearance", "tip_cosine", "pad_cosine", "joint_margin", "contact_height", "least_press",
)  # fmt: skip
FROZEN = Thresholds()


def frozen_for(hand: Hand) -> Thresholds:
    """Return the frozen thresholds for a hand's tips and torques.

    Tips of a radius below 1 cm go less deep, in proportion: their links are as narrow. Joints weaker than 0.7 Nm, or N
    of slides, press less, in proportion: they have to squeeze as well.
    """
    share, (low, high) = min(1.0, hand.tip_radius / 0.01), FROZEN.distance
    press = min(1.0, min(hand.joints.torque) / 0.7) * FROZEN.least_press
    return replace(
        FROZEN, tip_radius=hand.tip_radius, distance=(share * low, share * high), least_press=press
    )


def planned_friction(mu: float) -> tuple[float, float]:
    """Return `friction` and `friction_hold` for surfaces of coefficient `mu`; a larger one loosens nothing."""
    return min(FROZEN.friction, FRICTION_SHARE * mu), min(FROZEN.friction_hold, HOLD_SHARE * mu)


def thresholds_for(settings: Thresholds, hand: Hand) -> Thresholds:
    """Return what a grasp planned under `settings` for a hand is to be judged by.

    That is the frozen thresholds; but the friction planned with, where it is less, and whatever the settings ask
    less of than the frozen ones, so that `verify` can refuse it by name.
    """
    own = {"friction", "friction_hold", *settings.looser(hand), "tip_radius"}
    return replace(frozen_for(hand), **{name: getattr(settings, name) for name in own})
