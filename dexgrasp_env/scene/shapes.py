"""Geoms of a MuJoCo model as triangle meshes, in the geom's frame."""

from typing import Any

import numpy as np


def geom_mesh(model: Any, geom: int) -> Any:
    """Return a geom as a `trimesh.Trimesh`, m, or None for kinds that are not drawn (planes).

    NB: imported where a film is drawn: trimesh comes before any GL context.
    """
    import mujoco
    import trimesh

    kinds, size = mujoco.mjtGeom, model.geom_size[geom]
    kind = int(model.geom_type[geom])
    if kind == kinds.mjGEOM_MESH:
        return _stored(model, int(model.geom_dataid[geom]))
    if kind == kinds.mjGEOM_BOX:
        return trimesh.creation.box(2.0 * size)
    if kind == kinds.mjGEOM_SPHERE:
        return trimesh.creation.icosphere(subdivisions=2, radius=float(size[0]))
    if kind == kinds.mjGEOM_CAPSULE:
        capsule = trimesh.creation.capsule(height=2.0 * float(size[1]), radius=float(size[0]), count=[16, 16])
        capsule.apply_translation([0.0, 0.0, -capsule.bounds.mean(axis=0)[2]])
        return capsule
    if kind == kinds.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(radius=float(size[0]), height=2.0 * float(size[1]), sections=32)
    if kind == kinds.mjGEOM_ELLIPSOID:
        ball = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
        ball.apply_transform(np.diag([*size, 1.0]))
        return ball
    return None


def _stored(model: Any, mesh: int) -> Any:
    import trimesh

    vertex, face = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
    vertices = model.mesh_vert[vertex : vertex + int(model.mesh_vertnum[mesh])]
    faces = model.mesh_face[face : face + int(model.mesh_facenum[mesh])]
    return trimesh.Trimesh(vertices, faces, process=False)
