"""Settings of the planner, with where each number comes from."""

from dataclasses import dataclass, replace

from dexgrasp.grasp.thresholds import FROZEN, planned_friction
from dexgrasp.shape.parts import MOST_PARTS
from dexgrasp_env.valid import number

MOST = 10_000
GRASPS = number(ge=1, le=MOST, whole=True)._replace(
    words=f"a whole number from 1 to {MOST} (`dexgrasp dataset generate` makes more)"
)
"""How many grasps that differ may be asked for."""


@dataclass(frozen=True)
class PlannerSettings:
    """Settings of the planner; lengths in m, angles in rad. What a grasp must keep is `grasp.thresholds`' by default.

    Attributes:
        friction: coefficient that the planner counts on; the environment's default is 0.7, so there is a reserve.
        distance: range of the signed distance of the tip's inner sphere, (3) with d_min, d_max of section 1.2: the
            sphere centre lies `tip_radius` above it.
        tip_radius: effective radius of the compliant fingertip.
        closure_margin: least min-weight margin accepted (1 is the most that an even grasp can have).
        closure_aim: margin that the optimiser works towards before it settles for the least.
        clearance: least clearance of hand to object (tips apart), table and itself.
        tip_cosine: least cosine between a fingertip's axis and the inward normal: the back of a tip cannot press.
        pad_cosine: least cosine between the direction of its pad and the inward normal.
        joint_margin: distance kept from joint limits.
        surface_points: samples of the surface that triples are made of.
        table_clearance: proposed contacts are at least this high above the table.
        contact_height: contacts of a grasp are.
        triples: triples that are turned into hand postures.
        neighbours: postures of the hand's atlas looked at for each.
        postures: postures that are tried by the optimiser before the planner gives up.
        candidates: feasible configurations among which the firmest is carried out.
        breadths: rounds of the search; each multiplies the samples, and follows only where the last found nothing firm.
        patience: rounds more, looked at whole, where there are grasps and none bears the assumed weight.
        rises: of the tips, besides backing off, as the hand opens; those after the first only for grasps not firm.
        most_parts: convex parts of an object's cloud that are planned on; 1: its hull.
        initial_orientations: starting postures a proposal (six in section 3.3).
        iterations: steps of the SQP, for one posture.
        seconds: time after which no further posture is tried; None for results that do not depend on the machine.
        least_press: least pressing force of each contact, N: what the eye's error in place costs the squeeze.
        friction_hold: coefficient in whose cones the holding forces stay.
        loads: levels that the dataset sorts grasps by, firmest first: share of the assumed mass, and push in any
            direction that is borne, in weights.
        friction_squeeze: coefficient that the squeeze is made for, and grasps are ranked by: less than is counted on.
        place_error: how far the surface may be from where it was seen, m.
        firm_load: load under `friction_squeeze` and `place_error` with which the search ends.
        torque_share: share of the joint torque limits that the squeeze may use.
    """

    friction: float = FROZEN.friction
    distance: tuple[float, float] = FROZEN.distance
    tip_radius: float = FROZEN.tip_radius
    closure_margin: float = FROZEN.closure_margin
    closure_aim: float = 0.50
    clearance: float = FROZEN.clearance
    tip_cosine: float = FROZEN.tip_cosine
    pad_cosine: float = FROZEN.pad_cosine
    joint_margin: float = FROZEN.joint_margin
    surface_points: int = 96
    table_clearance: float = 0.015
    contact_height: float = FROZEN.contact_height
    triples: int = 40
    neighbours: int = 64
    postures: int = 60
    candidates: int = 4
    breadths: tuple[float, ...] = (1.0, 2.0, 3.0)
    patience: int = 4
    rises: tuple[float, ...] = (0.0, 0.006)
    most_parts: int = MOST_PARTS
    initial_orientations: int = 6
    iterations: int = 40
    seconds: float | None = None
    least_press: float = FROZEN.least_press
    friction_hold: float = FROZEN.friction_hold
    loads: tuple[tuple[float, float], ...] = ((1.0, 1.2), (1.0, 0.8), (1.0, 0.5), (1.0, 0.2), (0.6, 0.0))
    friction_squeeze: float = 0.42
    place_error: float = 0.003
    firm_load: float = 1.2
    torque_share: float = FROZEN.torque_share

    @classmethod
    def for_friction(cls, mu: float) -> "PlannerSettings":
        """Return settings that keep the usual reserve on surfaces of coefficient `mu`; see `planned_friction`."""
        friction, friction_hold = planned_friction(mu)
        return cls(friction=friction, friction_hold=friction_hold)

    @property
    def tip_height(self) -> float:
        """Height of a tip's centre above the surface that it touches, m: the middle of what `distance` allows."""
        return self.tip_radius + 0.5 * sum(self.distance)

    def broadened(self, factor: float) -> "PlannerSettings":
        """Return settings that sample `factor` times as many points, and triples and postures to match."""
        return replace(
            self, surface_points=round(factor * self.surface_points), triples=round(factor**2 * self.triples),
            postures=round(factor * self.postures),
        )  # fmt: skip
