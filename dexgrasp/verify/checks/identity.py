"""The object: is it the one stated, does it lie where stated, do assumed mass and centre follow from its shape."""

import numpy as np

from dexgrasp.geometry.exact import closest_on_mesh
from dexgrasp.grasp.identity import surface_hash
from dexgrasp.grasp.record import GraspRecord
from dexgrasp.verify.checks.check import LENGTH, ROUNDING, Check, at_most, same
from dexgrasp.verify.checks.scene import Scene
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.model import ObjectModel

OUTSIDE = (
    0.02  # m that the planned hull may stand out of the object: completion down to the table costs most of it
)
SUNK = 0.003  # m that the object's lowest point may be off the table
MASS = 1e-6  # kg
_DENSITY, _LEAST, _MOST = (
    900.0,
    0.08,
    0.65,
)  # kg/m3 and kg: what the mass of an object that nobody weighed is taken for


def identity_checks(record: GraspRecord, scene: Scene) -> list[Check]:
    """Check mass, centre of mass, and, where the file knows the object, that object and its pose."""
    return [*_mass_checks(record, scene), *_object_checks(record, scene)]


def _mass_checks(record: GraspRecord, scene: Scene) -> list[Check]:
    """Mass and centre of mass are the known ones, or follow from hull and parts."""
    known, centre = record.object.known_mass, record.object.known_centre
    mass = min(max(_DENSITY * scene.hull.volume, _LEAST), _MOST) if known is None else known
    middle = _middle(scene) if centre is None else np.array(centre)
    return [
        same("mass", abs(record.mass - mass), MASS, "kg"),
        same("centre of mass", float(np.abs(record.centre - middle).max()), LENGTH, "m"),
    ]


def _middle(scene: Scene) -> Array:
    """Centroid (3,) m of the parts' volumes."""
    volumes = np.array([part.volume for part in scene.parts])
    centres = np.array([part.center_mass for part in scene.parts])
    return np.asarray((volumes[:, None] * centres).sum(0) / volumes.sum())


def _object_checks(record: GraspRecord, scene: Scene) -> list[Check]:
    if record.object.source is None:
        return []
    try:
        model = record.object.load()
    except InputError as error:
        return [Check("object is here", 1.0, str(error), False)]
    assert model is not None
    checks = [
        Check("object content_hash", 0.0, "as stated", surface_hash(model) == record.object.content_hash),
        Check("object name", 0.0, model.name, model.name == record.object.name),
    ]
    if record.T_world_object is None or record.hull_offset is None:
        return checks
    return checks + _pose_checks(record, scene, model, record.T_world_object, record.hull_offset)


def _pose_checks(
    record: GraspRecord, scene: Scene, model: ObjectModel, T: Array, offset: Array
) -> list[Check]:
    """The pose is rigid, puts the object on the table, and puts it where the hull is."""
    rotation = T[:3, :3]
    rigid = float(np.abs(rotation @ rotation.T - np.eye(3)).max()) + float(np.abs(T[3] - [0, 0, 0, 1]).max())
    mesh = model.mesh.copy()
    mesh.apply_transform(T)
    true = mesh.convex_hull
    outside = float(closest_on_mesh(true, record.hull).distances.max())
    off = np.asarray(scene.hull.center_mass) - true.center_mass - offset
    return [
        at_most("T_world_object rigid", rigid + float(np.linalg.det(rotation) < 0.0), ROUNDING),
        at_most("object off the table", abs(float(mesh.bounds[0, 2])), SUNK, "m"),
        at_most("hull outside the object's", outside, OUTSIDE, "m"),
        same("hull_offset", float(np.abs(off).max()), LENGTH, "m"),
    ]
