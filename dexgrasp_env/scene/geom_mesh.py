"""Geom of a MuJoCo model as a triangle mesh, in the geom's frame."""

from typing import Any

from dexgrasp_env.objects.parts import KINDS, ContactPart
from dexgrasp_env.robot.hulls import mesh_of


def geom_mesh(model: Any, geom: int) -> Any:
    """Return a geom as a `trimesh.Trimesh`, m, or None for kinds that are not drawn (planes).

    NB: imported where a film is drawn: trimesh comes before any GL context.
    """
    import mujoco
    import trimesh

    kind = mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
    if kind == "mesh":
        return trimesh.Trimesh(*mesh_of(model, geom), process=False)
    return ContactPart(kind, model.geom_size[geom]).surface(detail=2) if kind in KINDS else None
