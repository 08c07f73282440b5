"""Changes of grasp files that the judge must refuse: of every field in turn, and of the object's name."""

import copy
import dataclasses

import numpy as np
import trimesh
from tables import table

from dexgrasp.grasp.file import record_of
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.verify.verify import PARTS, UNEXECUTED, verify
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import load_object

FREE = {"schema", "seed", "version", "versions", "created", "seconds", "planning_seconds", "agent"}
"""Fields that say where a file comes from; no physics hangs on them."""
SMALL = table("small")


def leaves(value, rng, path=(), field=""):
    """Yield path, field (its path without indices, phases by their names) and value of all that a file holds."""
    if isinstance(value, dict):
        if "setpoints" in value:
            field = f"{field.removesuffix('.phases')}.{value['name']}"
        for key, item in value.items():
            yield from leaves(item, rng, (*path, key), f"{field}.{key}".lstrip("."))
    elif isinstance(value, list):
        long = path[-1] in ("setpoints", "times") or (path[0] == "parts" and len(path) == 2)
        last = len(value) - 1
        for k in sorted({0, last, int(rng.integers(last + 1))}) if long else range(last + 1):
            yield from leaves(value[k], rng, (*path, k), field)
    elif value is not None:
        yield path, field, value


def changes(content, rng):
    """Yield path and new value of each change that is no smaller than what the field can mean."""
    for path, field, value in leaves({k: v for k, v in content.items() if k not in FREE}, rng):
        if isinstance(value, bool):
            yield path, not value
        elif isinstance(value, str):
            yield path, value + "x"
        else:
            for share in (0.01, -0.01, 0.1, -0.1):
                shift = share * value or share
                if abs(shift) > SMALL.get(field, 0.0):
                    yield path, value + shift


def is_accepted(content, path, value):
    """Return the judge's answer to a file with one change."""
    changed = copy.deepcopy(content)
    target = changed
    for key in path[:-1]:
        target = target[key]
    target[path[-1]] = value
    try:
        record = record_of(changed)
    except InputError:
        return False
    executed = [part for part in PARTS if part not in UNEXECUTED]  # dear: asked only of what the others pass
    return all(check.holds for parts in (UNEXECUTED, executed) for check in verify(record, parts))


def named(record, source, T_world_object):
    """Return a grasp that is said to be of an object that lies at `T_world_object` (4, 4)."""
    model = load_object(source)
    told = {"known_mass": record.object.known_mass, "known_centre": record.object.known_centre}
    true = T_world_object[:3, :3] @ model.solid.hull_centre + T_world_object[:3, 3]
    return dataclasses.replace(
        record,
        object=dataclasses.replace(ObjectIdentity.of(model, source), **told),
        T_world_object=T_world_object,
        hull_offset=_middle(record) - true,
    )


def standing(record, source):
    """Return a grasp that is said to be of another object, which stands under the planned hull's centre."""
    solid, T = load_object(source).solid, record.T_world_object.copy()
    T[:2, 3] = (_middle(record) - T[:3, :3] @ solid.hull_centre)[:2]
    T[2, 3] = -(solid.vertices @ T[2, :3]).min()
    return named(record, source, T)


def _middle(record):
    return trimesh.Trimesh(np.concatenate(record.parts), process=False).convex_hull.center_mass
