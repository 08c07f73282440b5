"""The certificate of a grasp: the residual of every constraint, in physical units."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from dexgrasp.grasp.field_types import Number, Numbers, Positive
from dexgrasp_env.arrays import Fields


@dataclass(frozen=True)
class Certificate:
    """Claims of a planner about a grasp; `verify` computes all of it again by another way. NaN is no claim.

    Attributes:
        distances_cm: signed distance of each tip (centre of the compliant sphere less its radius), as the contacts.
        force_ratio_percent: |sum f| / sum |f| of the forces of Eq. 4.
        torque_ratio_percent: |sum (p - c) x f| / sum |(p - c) x f|.
        closure_residual: optimum of Eq. 4 (f_min 1 N, torques over the object's radius).
        closure_margin: min-weight margin, 0 at the edge of closure, 1 at best.
        min_clearance_m: least clearance of hand and arm to object (grasping tips apart), table and themselves; links
            that the joint ranges keep 3 mm apart or more do not count.
        joint_limit_margin_rad: least distance to a joint limit.
        max_joint_torque_fraction: largest joint torque of the holding forces, at the contact points, over its limit.
        holds: whether the holding forces, within cones and torque limits, balance the assumed mass.
        hold_residual: what the holding forces leave of gravity, as a part of the weight.
        mass: kg, of the object as assumed (or known).
        load: 1 + the largest push in any direction, in assumed weights, that the holding forces bear (see
            `physics.strength`); below 1 the share of the weight that they balance.
        capacity: 1 + the largest push that any forces at these contacts could bear, the least of 26 directions.
        friction: coefficient that was planned with.
    """

    distances_cm: Numbers
    force_ratio_percent: Number
    torque_ratio_percent: Number
    closure_residual: Number
    closure_margin: Number
    min_clearance_m: Number
    joint_limit_margin_rad: Number
    max_joint_torque_fraction: Number
    holds: bool
    hold_residual: Number
    mass: Positive
    load: Number
    capacity: Number
    friction: Number

    @classmethod
    def unclaimed(cls, contacts: int) -> "Certificate":
        """Return one that claims nothing of a grasp with so many contacts."""
        numbers: Fields = dict.fromkeys(cls.__annotations__, math.nan)
        return cls(**numbers | {"distances_cm": (math.nan,) * contacts, "holds": False})

    def as_json(self) -> Fields:
        """Return the certificate as JSON holds it."""
        return asdict(self) | {"distances_cm": list(self.distances_cm)}


_FORMS = {
    "fingertip distances, cm (allowed -0.68 .. -0.32)": "{distances}",
    "closure margin (0 edge, 1 best)": "{closure_margin:.2f}",
    "force ratio, %": "{force_ratio_percent:.1e}",
    "torque ratio, %": "{torque_ratio_percent:.1e}",
    "least clearance, mm": "{clearance_mm:.1f}",
    "distance to a joint limit, rad": "{joint_limit_margin_rad:.3f}",
    "joint torque over its limit": "{max_joint_torque_fraction:.2f}",
    "load (1: bears its weight, 2: and a push as large)": "{load:.2f}",
    "capacity (the same of any forces within the torques)": "{capacity:.2f}",
    "holds": "{holds} (assumed to weigh {grams:.0f} g)",
}


def figures_of(certificate: Fields, forms: Mapping[str, str] = _FORMS) -> dict[str, str]:
    """Return the figures of a certificate as text, by name.

    Args:
        certificate: as JSON holds it.
        forms: format strings of its fields, by name.
    """
    shown = certificate | {
        "distances": " ".join(f"{d:.2f}" for d in certificate["distances_cm"]),
        "clearance_mm": 1000 * certificate["min_clearance_m"],
        "grams": 1000 * certificate["mass"],
    }
    return {name: form.format(**shown) for name, form in forms.items()}
