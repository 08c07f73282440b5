"""Checks of contacts: places and directions of the tips, requests, and the joints' distance from their limits."""

import mujoco
import numpy as np

from dexgrasp.geometry.request import Demand, GraspRequest
from dexgrasp.grasp.thresholds import PRESSED, planned_friction
from dexgrasp.grasp.verify.case import Case
from dexgrasp.grasp.verify.check import LENGTH, ROUNDING, Check, at_least, at_most, claim, flag, same
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.robot import SLIDE


def contact_checks(case: Case) -> list[Check]:
    """Check depth, contacts, normals, height and the tips' directions."""
    limits, touch, inward = case.limits, case.touch, -case.touch.normals
    depth = touch.distance - limits.tip_radius
    (low, high), shown = limits.distance, "[{:.2f}, {:.2f}] cm".format(*np.multiply(100.0, limits.distance))
    within = (low - LENGTH <= depth) & (depth <= high + LENGTH)
    cosine = 2e-4  # what the optimiser leaves of an angle
    return [
        *(
            Check(f"distance:{finger}", 100.0 * float(d), shown, bool(good))
            for finger, d, good in zip(case.record.fingers, depth, within, strict=True)
        ),
        at_most("contacts as claimed", np.abs(touch.points - case.record.points).max(), LENGTH, "m"),
        # of unit vectors
        at_most("normals as claimed", np.abs(touch.normals - case.record.normals).max(), 1e-5),
        *claim(case, "distances_cm", 100.0 * depth, 100.0 * LENGTH, unit="cm"),
        at_least("contact height", touch.points[:, 2].min(), limits.lowest_contact(case.top), "m", LENGTH),
        at_least("tip cosine", (touch.axes * inward).sum(1).min(), limits.tip_cosine, "", cosine),
        at_least("pad cosine", (touch.pads * inward).sum(1).min(), limits.pad_cosine, "", cosine),
    ]


def request_checks(case: Case) -> list[Check]:
    """Check that the grasp is as the file says that was asked; nothing where nothing was."""
    asked = case.record.request
    if asked is None:
        return []
    found = []
    if asked.hold or asked.avoid:
        demand = Demand(asked, case.cell.T_base_world)
        off = demand.outside(case.touch.points).max()
        found.append(at_most("contacts outside the request", off, 0.0, "m", LENGTH))
        surface = _surface(np.concatenate([part.triangles for part in case.scene.parts]))
        off = case.scene.in_tips(case.record.q, surface[demand.outside(surface) > 0.0])
        found.append(at_most("surface outside the request in the tips", off, PRESSED, "m"))
    if asked.approach is not None:
        face = (case.cell.T_base_world @ case.scene.palm(case.record.q))[:3, 0]
        off = asked.approach.off(face[None])[0]
        # what two ways to compute an angle may differ by
        found.append(at_most("palm direction", off, asked.approach.degrees, "degrees", 0.01))
    if asked.max_force is not None:
        found.append(at_most("pressing force", case.hold.press.max(), asked.max_force, "N", 1e-4))
    if asked.fingers:
        found.append(flag("fingers as requested", set(asked.fingers) == set(case.record.fingers)))
    return found + _known_checks(case, asked)


def _surface(triangles: Array) -> Array:
    """Return points (N, 3) m of triangles (F, 3, 3), 1 mm apart at most."""
    from trimesh.remesh import subdivide_to_size

    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    points: Array = subdivide_to_size(triangles.reshape(-1, 3), faces, 0.001, max_iter=20)[0]
    return points


def _known_checks(case: Case, asked: GraspRequest) -> list[Check]:
    """Check that a grasp counts on no other mass and no more friction than was said, and is as likely to hold."""
    found, limits, known = [], case.limits, case.record.holds_probability
    if asked.friction is not None:
        more = np.subtract((limits.friction, limits.friction_hold), planned_friction(asked.friction))
        found.append(at_most("friction over the request's", more.max(), 0.0, "", ROUNDING))
    if asked.mass is not None:
        off = abs(case.record.certificate.mass - asked.mass)
        found.append(at_most("mass off the request's", off, 0.0, "kg", 1e-6))
    if asked.min_probability is not None:
        sure = 0.0 if known is None else known.lifted.value
        found.append(at_least("probability to be lifted and held", sure, asked.min_probability))
    return found


def limit_checks(case: Case) -> list[Check]:
    """Check the joint range of every configuration, and the margin of the grasp."""
    record, robot = case.record, case.robot
    rows = np.stack([record.q, record.pregrasp, record.grasp, record.squeeze])
    rooms, (C, c) = np.minimum(rows - robot.lower, robot.upper - rows), robot.drive
    slide = case.scene.model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
    busy = np.delete(rooms[0] / np.where(slide, SLIDE, 1.0), [*case.idle, *np.flatnonzero(~C.any(1))])
    strays = rows - rows @ C.T - c
    strays[1] = rows[1] - robot.freed(rows[1])
    tied = robot.hand.couplings or robot.hand.tendons
    coupled = [same("coupled joints", np.abs(strays).max(), ROUNDING, "rad")] if tied else []
    return [
        at_least("joint margin", busy.min(), case.limits.joint_margin, "rad", 1e-6),
        *(
            at_least(f"joint limits:{name}", room.min(), 0.0, "rad", ROUNDING)
            for name, room in zip(("q", "pregrasp", "grasp", "squeeze"), rooms, strict=True)
        ),
        *coupled,
        *claim(case, "joint_limit_margin_rad", rooms[0].min(), ROUNDING, unit="rad"),
    ]
