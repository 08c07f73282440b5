"""An object as geoms of a MuJoCo specification."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.parts import ContactPart

if TYPE_CHECKING:
    import mujoco


def add_to_spec(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    model: ObjectModel,
    *,
    name: str = "object",
    visual: bool = True,
    **contact: Any,
) -> list[str]:
    """Give `body` the shape and the mass of `model`; its frame becomes the object frame.

    Adds the geom `NAME_visual` (group 2, collides with nothing), the geoms `NAME_0`, `NAME_1`, ... (group 3) and the
    inertia. Joints and friction are the caller's.

    Args:
        spec: the specification that `body` belongs to; it receives the meshes.
        body: an empty body.
        model: the object.
        name: that its geoms' names begin with.
        visual: whether to add the visual geom.
        **contact: attributes set on every contact geom, e.g. `condim=3`, `solref=[0.02, 1]`.

    Returns:
        The names of the contact geoms.
    """
    body.explicitinertial = True
    body.mass, body.ipos = model.mass, [0.0, 0.0, 0.0]
    body.fullinertia = model.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    if visual:
        _add_visual(spec, body, model, f"{name}_visual")
    names = []
    for index, part in enumerate(model.parts):
        names.append(f"{name}_{index}")
        geom = _add_part(spec, body, part, names[-1])
        geom.group = 3
        geom.rgba = model.rgba
        for key, value in contact.items():
            setattr(geom, key, value)
    return names


def _add_visual(spec: mujoco.MjSpec, body: mujoco.MjsBody, model: ObjectModel, name: str) -> None:
    import mujoco

    mesh = spec.add_mesh(name=name)
    mesh.uservert = np.asarray(model.solid.vertices, dtype=np.float32).ravel()
    mesh.userface = np.asarray(model.solid.faces, dtype=np.int32).ravel()
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    spec.add_material(name=name, rgba=model.rgba, specular=0.3, shininess=0.4)
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        material=name,
        group=2,
        contype=0,
        conaffinity=0,
        density=0.0,
    )


def _add_part(spec: mujoco.MjSpec, body: mujoco.MjsBody, part: ContactPart, name: str) -> mujoco.MjsGeom:
    import mujoco

    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{part.kind.upper()}")
    geom = body.add_geom(name=name, type=kind, pos=part.position, quat=part.quat_wxyz)
    if part.kind == "mesh":
        spec.add_mesh(name=name, uservert=np.asarray(part.vertices, dtype=np.float32).ravel())
        geom.meshname = name
    else:
        geom.size = part.size
    return geom
