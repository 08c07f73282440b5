"""An object as geoms of a MuJoCo specification."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dexgrasp_env.objects.model import ObjectModel

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
    import mujoco

    body.explicitinertial = True
    body.mass, body.ipos = model.mass, [0.0, 0.0, 0.0]
    body.fullinertia = model.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    if visual:
        from dexgrasp_env.robot.rebuilt import add_mesh_geom

        own = f"{name}_visual"
        spec.add_material(name=own, rgba=model.rgba, specular=0.3, shininess=0.4)
        look = {"name": own, "material": own, "group": 2, "contype": 0, "conaffinity": 0, "density": 0.0}
        add_mesh_geom(spec, body, model.solid.vertices, model.solid.faces, look)
    names = [f"{name}_{index}" for index in range(len(model.parts))]
    for own, part in zip(names, model.parts, strict=True):
        geom = body.add_geom(
            name=own, type=getattr(mujoco.mjtGeom, f"mjGEOM_{part.kind.upper()}"), size=part.size,
            pos=part.position, quat=part.quat_wxyz, group=3, rgba=model.rgba, **contact,
        )  # fmt: skip
        if part.kind == "mesh":
            spec.add_mesh(name=own, uservert=part.vertices.ravel())
            geom.meshname = own
    return names
