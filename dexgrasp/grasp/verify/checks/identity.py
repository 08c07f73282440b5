"""Checks of the object: the one stated, under hull and tips, with mass and centre its own or of its shape."""

from typing import Any

import numpy as np

from dexgrasp.geometry.mesh_distance import closest_on_mesh
from dexgrasp.grasp.identity import surface_hash
from dexgrasp.grasp.thresholds import (
    CONTACT_INSIDE,
    HULL_OUTSIDE,
    OBJECT_OUTSIDE,
    OVERLAP,
    TIP_SHORT,
    TOLD_CENTRE,
    TOLD_MASS,
)
from dexgrasp.grasp.verify.case import Case
from dexgrasp.grasp.verify.check import LENGTH, ROUNDING, Check, at_least, at_most, flag, same
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import has_own_size
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.shapes import to_manifold


def identity_checks(case: Case) -> list[Check]:
    """Check mass, centre of mass, and, where the file knows the object, that object and its pose.

    Mass and centre of mass are the known ones, or follow from hull and parts.
    """
    known, record, parts = case.record.object, case.record, case.scene.parts
    volumes = np.array([part.volume for part in parts])
    middle = volumes @ [part.center_mass for part in parts] / volumes.sum()
    assumed = np.clip(900.0 * case.scene.hull.volume, 0.08, 0.65)  # kg/m3, and kg: of what nobody weighed
    mass = assumed if known.known_mass is None else known.known_mass
    centre = middle if known.known_centre is None else known.known_centre
    return [
        same("mass", abs(record.certificate.mass - mass), 1e-6, "kg"),
        same("centre of mass", np.abs(record.centre - centre).max(), LENGTH, "m"),
        *_object_checks(case),
    ]


def _object_checks(case: Case) -> list[Check]:
    stated = case.record.object
    try:
        model = stated.load()
    except InputError as error:
        return [flag("object is here", False, str(error))]
    if model is None:
        return []
    return [
        flag("object content_hash", surface_hash(model) == stated.content_hash, "as stated"),
        flag("object name", model.name == stated.name, model.name),
        *_told_checks(case, model),
        *_pose_checks(case, model),
    ]


def _told_checks(case: Case, model: ObjectModel) -> list[Check]:
    """Check mass and centre that the planner was told; nobody else knows what a bare mesh file weighs."""
    stated, T, found = case.record.object, case.record.T_world_object, []
    if has_own_size(str(stated.source)):
        if stated.known_mass is not None:
            found.append(same("mass of the object", abs(stated.known_mass / model.mass - 1.0), TOLD_MASS))
        if stated.known_centre is not None and T is not None:
            off = np.linalg.norm(stated.known_centre - T[:3, 3])
            found.append(same("centre of the object", off, TOLD_CENTRE, "m"))
    return found


def _pose_checks(case: Case, model: ObjectModel) -> list[Check]:
    """Check that the pose is rigid, and puts the object on the table where hull and contacts are."""
    T, offset = case.record.T_world_object, case.record.hull_offset
    if T is None or offset is None:
        return [flag("T_world_object given", False, "where a source is")]
    rotation = T[:3, :3]
    rigid = np.abs(rotation @ rotation.T - np.eye(3)).max() + np.abs(T[3] - [0, 0, 0, 1]).max()
    mesh, hull = model.mesh.copy(), case.scene.hull
    mesh.apply_transform(T)
    true = mesh.convex_hull
    off = hull.center_mass - true.center_mass - offset
    inside = -closest_on_mesh(mesh, case.record.points).distances.min()
    short = closest_on_mesh(mesh, case.touch.tips).distances.max() - case.limits.tip_radius
    return [
        at_most("T_world_object rigid", rigid + (np.linalg.det(rotation) < 0.0), ROUNDING),
        # m that the object's lowest point may be off the table
        at_most("object off the table", abs(mesh.bounds[0, 2]), 0.003, "m"),
        at_most("contacts inside the object", inside, CONTACT_INSIDE, "m"),
        at_most("tips short of the object", short, TIP_SHORT, "m"),
        at_most("hull outside the object's", _outside(true, hull), HULL_OUTSIDE, "m"),
        at_most("object outside the hull", _outside(hull, true), OBJECT_OUTSIDE, "m"),
        at_least("volume that hull and object share", _overlap(hull, true), OVERLAP),
        same("hull_offset", np.abs(off).max(), LENGTH, "m"),
    ]


def _outside(hull: Any, other: Any) -> float:
    """Return how far another mesh stands out of a convex one, m."""
    return closest_on_mesh(hull, other.vertices).distances.max()


def _overlap(hull: Any, other: Any) -> float:
    """Return the volume common to two convex meshes as a share of what either fills."""
    common = (to_manifold(hull) ^ to_manifold(other)).volume()
    return common / (hull.volume + other.volume - common)
