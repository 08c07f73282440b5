"""Forces: closure, balance, cones, joint torques, and how strong they and any others could be.

The planner has a closed form of the margin, minimises over boundary normals for `load`, and cuts planes for `capacity`.
Here: cone programmes of clarabel, and rays through the cones for `load`.
"""

import numpy as np

from dexgrasp.grasp.record import GraspRecord
from dexgrasp.verify.checks.check import Check, at_least, at_most, claim
from dexgrasp.verify.checks.scene import Scene, Touch
from dexgrasp.verify.cones import conic_margin, conic_residual, largest_push, pyramid_forces, wrench_map
from dexgrasp.verify.rays import least_way
from dexgrasp_env.arrays import Array

GRAVITY = 9.81  # m/s^2
RESIDUAL = 1e-6  # N^2, as in the paper's feasibility test
MARGIN = 1e-4
BALANCE = 1e-4  # of the weight
CONE = 1e-6  # of the friction used
TORQUE = 1e-5  # of the limit
LOAD, CAPACITY = 1e-3, 2e-3  # relative
_RATIO = 1e-3  # percent
_NOT_SHOWN = -1e3  # stands for a margin that was not found


def closure_checks(record: GraspRecord, touch: Touch) -> list[Check]:
    """Check wrench closure in the exact cones of the planned friction, and its claims."""
    mu, least = record.thresholds.friction, record.thresholds.closure_margin
    residual = conic_residual(touch.points, touch.normals, mu).upper
    found = conic_margin(touch.points, touch.normals, mu)
    margin = _NOT_SHOWN if found is None else found
    return [
        Check("Eq. 4 residual, exact cone", residual, f"< {RESIDUAL} N^2", residual < RESIDUAL),
        at_least("closure margin, exact cone", margin, least, "", MARGIN),
        *claim(record, "closure_margin", margin, MARGIN, 1e-4),
        *claim(record, "friction", mu, 1e-12),
        *_claims_of_eq4(record, touch),
    ]


def _claims_of_eq4(record: GraspRecord, touch: Touch) -> list[Check]:
    """Residual and ratios of the forces of Eq. 4, as it is in the paper (pyramids of Eq. 2)."""
    points = touch.points
    forces = pyramid_forces(points, touch.normals, record.thresholds.friction)
    wrench = wrench_map(points, points.mean(0)) @ forces.ravel()
    arms = np.cross(points - record.centre, forces)
    return [
        *claim(record, "closure_residual", float(wrench @ wrench), RESIDUAL, 1e-3, "N^2"),
        *claim(record, "force_ratio_percent", _ratio(forces), _RATIO, 1e-3),
        *claim(record, "torque_ratio_percent", _ratio(arms), _RATIO, 1e-3),
    ]


def _ratio(vectors: Array) -> float:
    total = float(np.linalg.norm(vectors, axis=1).sum())
    return 100.0 * float(np.linalg.norm(vectors.sum(0))) / total if total > 0.0 else 0.0


class Hold:
    """What the planned forces do about the centre of mass, in weights: balance, friction and torque that they use."""

    def __init__(self, record: GraspRecord, scene: Scene, touch: Touch) -> None:
        """Compute it."""
        self.forces, self.normals = record.grasp.forces, touch.normals
        self.mu, self.weight = record.thresholds.friction_hold, GRAVITY * record.mass
        self.G = wrench_map(touch.points, record.centre)
        self.wrench = self.G @ self.forces.ravel() / self.weight
        self.left = self.wrench - [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        self.press = -(self.forces * self.normals).sum(1)
        sliding = np.linalg.norm(self.forces + self.press[:, None] * self.normals, axis=1)
        self.friction_use = float((sliding / np.maximum(self.mu * self.press, 1e-9)).max())
        most = scene.robot.max_torque
        self.torques = touch.jacobians.transpose(2, 0, 1).reshape(len(most), -1) / most[:, None]
        self.torque_use = float(np.abs(self.torques @ self.forces.ravel()).max())


def force_checks(record: GraspRecord, scene: Scene, touch: Touch) -> list[Check]:
    """Check that the forces balance gravity within cones and joint torques, and what is claimed of them."""
    hold, limits = Hold(record, scene, touch), record.thresholds
    kinds = (("forces", hold.left[:3]), ("torques", hold.left[3:]))
    return [
        *(at_most(f"{kind} leave of gravity", float(np.linalg.norm(left)), BALANCE, "of the weight")
          for kind, left in kinds),
        at_least("least pressing force", float(hold.press.min()), limits.least_press, "N", 1e-4),
        at_most("share of friction used", hold.friction_use, 1.0, "", CONE),
        at_most("joint torque over limit", hold.torque_use, limits.torque_share, "", TORQUE),
        *claim(record, "max_joint_torque_fraction", hold.torque_use, TORQUE),
        *claim(record, "hold_residual", float(np.linalg.norm(hold.left)), BALANCE, 1e-3),
    ]  # fmt: skip


def strength_checks(record: GraspRecord, scene: Scene, touch: Touch) -> list[Check]:
    """Check `load` and `capacity`, and that `holds` says what they say."""
    hold = Hold(record, scene, touch)
    found, claimed = _load(hold), record.grasp.certificate.holds
    return [
        at_least("load", found, 1.0, "", LOAD),
        *claim(record, "load", found, 0.0, LOAD),
        *claim(record, "capacity", _capacity(hold), 0.0, CAPACITY),
        Check("holds as claimed", float(claimed), f"{found >= 1.0 - LOAD}", claimed == (found >= 1.0 - LOAD)),
    ]


def _load(hold: Hold) -> float:
    """Return `load` (interface: 1 + D, or the share below 1) by following pushes until a force leaves its cone."""
    share = float(hold.wrench[2])
    unbalanced = np.linalg.norm(np.delete(hold.wrench, 2)) > BALANCE or share <= 0.0
    if unbalanced or hold.torque_use > 1.0 + TORQUE or not 0.0 <= hold.friction_use <= 1.0 + CONE:
        return 0.0
    if share < 1.0 - BALANCE:
        return share
    wanted = -hold.weight * np.eye(6, 3)
    answer: Array = np.asarray(np.linalg.lstsq(hold.G, wanted, rcond=1e-9)[0], dtype=np.float64)
    if np.abs(hold.G @ answer - wanted).max() > 1e-6 * hold.weight:
        return 1.0
    return 1.0 + least_way(hold.forces, answer, hold.normals, hold.mu)


def _capacity(hold: Hold) -> float:
    """Return `capacity` (interface: 1 + the least of 26, or the share below 1); 0 where a programme is not solved."""

    def most(constant: Array, direction: Array) -> float:
        push = hold.weight * np.r_[constant, np.zeros(3)], hold.weight * np.r_[direction, np.zeros(3)]
        found = largest_push(hold.G, hold.normals, hold.mu, hold.torques, push)
        return 0.0 if found is None else found

    gravity = np.array([0.0, 0.0, -1.0])
    down = most(np.zeros(3), gravity)
    if down < 1.0:
        return down
    grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), -1).reshape(-1, 3)
    return 1.0 + min(most(gravity, d / np.linalg.norm(d)) for d in grid if d.any())
