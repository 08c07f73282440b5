"""Accuracy of a segmented cloud against the simulation's true shape."""

import numpy as np
from scipy.spatial import ConvexHull

from dexgrasp.geometry.hull import cloud_corners
from dexgrasp_env.perception.cloud import cells_of, gather
from dexgrasp_env.poses import pose_matrix

FALSE_POINT = 0.010  # m: a point farther from the object than this is not of the object
TABLE_BAND = 0.008  # m: a stray point lower than this may be the table's noise
OFF_OBJECT = 0.004  # m: a point of another thing's pixel, farther off than this, is stray
COVER_RADIUS = 0.006  # m: a visible place is covered by a point this near


def measure_accuracy(scene, perception, data, mesh):
    """Judge what was seen of the body `object`.

    Args:
        scene: what was seen.
        perception: that saw it.
        data: the scene as it is.
        mesh: the object's true surface, object frame.

    Returns:
        median, p95, worst: distance of the points to the true surface, metres.
        covered: share of the surface that some camera truly sees and that has a point within 6 mm.
        false_points: points farther than 10 mm from the object.
        stray_points: points whose pixel truly shows something else, more than 4 mm off the object:
            what the table left, and pixels that fly between the object's edge and the table.
        table_points: those of them lower than 8 mm.
        hull_volume: volume of the cloud's completed hull over that of the true hull.
        reason: why there is no cloud, and then nothing else; or None.
    """
    if scene.reason:
        return {"reason": scene.reason}
    points, body = scene.target.points, data.body("object")
    distance = surface_distance(points, mesh, pose_matrix(body.xpos, body.xquat))
    of_object = np.isin(perception.rays.segment(data), np.flatnonzero(data.model.geom_bodyid == body.id))
    visible = gather(np.where(of_object, perception.rays.render(data), np.inf), perception.cameras).points
    stray = (distance > OFF_OBJECT) & ~of_object.ravel()[scene.target.pixels]
    corners = cloud_corners(points, scene.plane)
    volume = np.nan if corners is None else ConvexHull(corners).volume
    return {
        "median": np.median(distance),
        "p95": np.percentile(distance, 95),
        "worst": distance.max(),
        "covered": covered_share(points, visible),
        "false_points": int((distance > FALSE_POINT).sum()),
        "stray_points": int(stray.sum()),
        "table_points": int((stray & (points[:, 2] < TABLE_BAND)).sum()),
        "hull_volume": volume / mesh.convex_hull.volume,
        "reason": None,
    }


def surface_distance(points, mesh, T_world_object):
    """Return distances (M,) m of world points (M, 3) to the surface of a mesh at a pose."""
    from dexgrasp.geometry.mesh_distance import closest_on_mesh

    local = (points - T_world_object[:3, 3]) @ T_world_object[:3, :3]
    return np.abs(closest_on_mesh(mesh, local).distances)


def covered_share(points, visible):
    """Return the share of the truly visible points (V, 3) that have a cloud point within 6 mm.

    The visible points are thinned to one a 3 mm voxel, so that the share is one of area, not of pixels.
    """
    from scipy.spatial import cKDTree

    if not len(visible):
        return float("nan")
    _, first = np.unique(cells_of(visible, 0.003), return_index=True)
    return float((cKDTree(points).query(visible[first])[0] <= COVER_RADIUS).mean())
