"""Meshes of models, convex hulls of points, and cuts through them."""

from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array, box_corners


def mesh_of(model: Any, geom: int) -> tuple[Array, Any]:
    """Return vertices (n, 3) m and faces (m, 3) of a geom that is a mesh of a MuJoCo model, in its own frame."""
    mesh = model.mesh(int(model.geom_dataid[geom]))
    (vertex,), (face,) = mesh.vertadr, mesh.faceadr
    return model.mesh_vert[vertex : vertex + mesh.vertnum[0]], model.mesh_face[face : face + mesh.facenum[0]]


def corners_of(model: Any, geom: int) -> Array:
    """Return points (n, 3) m of a geom of a MuJoCo model, of the box around one that is no mesh, in its own frame."""
    import mujoco

    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        return mesh_of(model, geom)[0]
    middle, half = np.split(model.geom_aabb[geom], 2)
    return middle + box_corners(-half, half)


def colour_of(model: Any, geom: int) -> Array:
    """Return the colour (4,) of a geom of a MuJoCo model: its material's where it has one."""
    material = model.geom_matid[geom]
    return model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]


def hull_of(points: Array) -> tuple[Array, Any]:
    """Return corners (n, 3) m and triangles (m, 3) of the convex hull of points (k, 3) m, seen from outside."""
    from trimesh.convex import convex_hull

    hull = convex_hull(points, qhull_options="Qt")
    return np.asarray(hull.vertices), np.asarray(hull.faces)


def planes_of(points: Array) -> Array:
    """Return the planes (m, 4) of a hull; of what is flat to rounding, those of points that are joggled."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        equations = ConvexHull(points).equations
    except QhullError:
        equations = ConvexHull(points, qhull_options="QJ").equations
    return np.unique(equations.round(9), axis=0)


def cut(points: Array, height: float) -> tuple[Array, Array]:
    """Return corners (n, 3) m of what lies above, and of what lies below a height, of the hull of points (k, 3) m."""
    corners, faces = hull_of(points)
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    a, b = corners[edges.T]
    crossing = (a[:, 2] - height) * (b[:, 2] - height) < 0
    a, b = a[crossing], b[crossing]
    between = a + ((height - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None] * (b - a)
    above, below = corners[corners[:, 2] >= height], corners[corners[:, 2] <= height]
    return np.concatenate([above, between]), np.concatenate([below, between])
