"""The object: is it the one stated, does it lie where stated, do assumed mass and centre follow from its shape."""

import numpy as np

from dexgrasp.geometry.exact import closest_on_mesh
from dexgrasp.grasp.identity import surface_hash
from dexgrasp.verify.case import Case
from dexgrasp.verify.check import LENGTH, ROUNDING, Check, at_most, same
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.model import ObjectModel

OUTSIDE = 0.02
"""m that the planned hull may stand out of the object: completion down to the table costs most of it."""
SUNK = 0.003  # m that the object's lowest point may be off the table
MASS = 1e-6  # kg
_DENSITY, _RANGE = 900.0, (0.08, 0.65)  # kg/m3 and kg: what an object that nobody weighed is taken for


def identity_checks(case: Case) -> list[Check]:
    """Check mass, centre of mass, and, where the file knows the object, that object and its pose."""
    return [*_mass_checks(case), *_object_checks(case)]


def _mass_checks(case: Case) -> list[Check]:
    """Mass and centre of mass are the known ones, or follow from hull and parts."""
    known, record, parts = case.record.object, case.record, case.scene.parts
    volumes = np.array([part.volume for part in parts])
    middle = volumes @ [part.center_mass for part in parts] / volumes.sum()
    mass = (
        np.clip(_DENSITY * case.scene.hull.volume, *_RANGE) if known.known_mass is None else known.known_mass
    )
    centre = middle if known.known_centre is None else known.known_centre
    return [
        same("mass", abs(record.certificate.mass - mass), MASS, "kg"),
        same("centre of mass", np.abs(record.centre - centre).max(), LENGTH, "m"),
    ]


def _object_checks(case: Case) -> list[Check]:
    stated = case.record.object
    try:
        model = stated.load()
    except InputError as error:
        return [Check("object is here", 1.0, str(error), False)]
    if model is None:
        return []
    same_surface, same_name = surface_hash(model) == stated.content_hash, model.name == stated.name
    return [
        Check("object content_hash", float(not same_surface), "as stated", same_surface),
        Check("object name", float(not same_name), model.name, same_name),
        *_pose_checks(case, model),
    ]


def _pose_checks(case: Case, model: ObjectModel) -> list[Check]:
    """The pose is rigid, puts the object on the table, and puts it where the hull is."""
    T, offset = case.record.T_world_object, case.record.hull_offset
    if T is None or offset is None:
        return []
    rotation = T[:3, :3]
    rigid = np.abs(rotation @ rotation.T - np.eye(3)).max() + np.abs(T[3] - [0, 0, 0, 1]).max()
    mesh = model.mesh.copy()
    mesh.apply_transform(T)
    true = mesh.convex_hull
    outside = closest_on_mesh(true, case.record.hull).distances.max()
    off = case.scene.hull.center_mass - true.center_mass - offset
    return [
        at_most("T_world_object rigid", rigid + (np.linalg.det(rotation) < 0.0), ROUNDING),
        at_most("object off the table", abs(mesh.bounds[0, 2]), SUNK, "m"),
        at_most("hull outside the object's", outside, OUTSIDE, "m"),
        same("hull_offset", np.abs(off).max(), LENGTH, "m"),
    ]
