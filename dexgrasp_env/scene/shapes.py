"""Geoms of a MuJoCo model as triangle meshes, in the geom's frame."""

from typing import Any

from dexgrasp_env.objects.parts import KINDS, ContactPart


def geom_mesh(model: Any, geom: int) -> Any:
    """Return a geom as a `trimesh.Trimesh`, m, or None for kinds that are not drawn (planes).

    NB: imported where a film is drawn: trimesh comes before any GL context.
    """
    import mujoco
    import trimesh

    kind = mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
    if kind == "mesh":
        mesh = model.mesh(int(model.geom_dataid[geom]))
        vertex, face = int(mesh.vertadr[0]), int(mesh.faceadr[0])
        vertices = model.mesh_vert[vertex : vertex + int(mesh.vertnum[0])]
        return trimesh.Trimesh(vertices, model.mesh_face[face : face + int(mesh.facenum[0])], process=False)
    return ContactPart(kind, model.geom_size[geom]).surface(detail=2) if kind in KINDS else None
