"""How good a segmented cloud is, judged by what only the simulation knows."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp.shape.hull import cloud_hull
from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.cloud import gather
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.robot.camera import Camera

if TYPE_CHECKING:
    import mujoco
    import trimesh

FALSE_POINT = 0.010  # m: a point farther from the object than this is not of the object
TABLE_BAND = 0.008  # m: a stray point lower than this may be the table's noise
OFF_OBJECT = 0.004  # m: a point of another thing's pixel, farther off than this, is stray
COVER_RADIUS = 0.006  # m: a visible place is covered by a point this near


@dataclass(frozen=True)
class Accuracy:
    """The measures of one observation; NaN where there is no cloud.

    Attributes:
        median, p95, worst: distance of the points to the true surface, metres.
        covered: share of the surface that some camera truly sees and that has a point within 6 mm.
        false_points: points farther than 10 mm from the object.
        stray_points: points whose pixel truly shows something else, more than 4 mm off the object:
            what the table left, and pixels that fly between the object's edge and the table.
        table_points: those of them lower than 8 mm.
        hull_volume: volume of the cloud's hull over that of the true hull.
        reason: why there is no cloud, or None.
    """

    median: float
    p95: float
    worst: float
    covered: float
    false_points: int
    stray_points: int
    table_points: int
    hull_volume: float
    reason: str | None


def measure_accuracy(
    scene: Scene,
    mesh: "trimesh.Trimesh",
    T_world_object: Array,
    true_depths: NDArray[Any],
    geoms: NDArray[Any],
    cameras: tuple[Camera, ...],
    object_geoms: NDArray[Any],
) -> Accuracy:
    """Judge a cloud.

    Args:
        scene: what was seen.
        mesh: the true surface, object frame.
        T_world_object: (4, 4) true pose.
        true_depths: (cameras, H, W) m without sensor errors.
        geoms: (cameras, H, W) geom ids of the same images.
        cameras: the true cameras.
        object_geoms: ids of the object's visible geoms.
    """
    if scene.reason is not None:
        nan = float("nan")
        return Accuracy(nan, nan, nan, nan, 0, 0, 0, nan, scene.reason)
    points = scene.target.points
    distance = surface_distance(points, mesh, T_world_object)
    of_object = np.isin(geoms, object_geoms)
    visible = gather(np.where(of_object, true_depths, np.inf), cameras).points
    elsewhere = ~of_object.ravel()[scene.target.pixels]
    stray = (distance > OFF_OBJECT) & elsewhere
    return Accuracy(
        median=float(np.median(distance)),
        p95=float(np.percentile(distance, 95)),
        worst=float(distance.max()),
        covered=covered_share(points, visible),
        false_points=int((distance > FALSE_POINT).sum()),
        stray_points=int(stray.sum()),
        table_points=int((stray & (points[:, 2] < TABLE_BAND)).sum()),
        hull_volume=hull_volume_ratio(scene, mesh),
        reason=None,
    )


def surface_distance(points: Array, mesh: "trimesh.Trimesh", T_world_object: Array) -> Array:
    """Return distances (M,) m of world points (M, 3) to the surface of a mesh at a pose."""
    from dexgrasp.geometry.exact import closest_on_mesh

    local = (points - T_world_object[:3, 3]) @ T_world_object[:3, :3]
    return np.abs(closest_on_mesh(mesh, local).distances)


def covered_share(points: Array, visible: Array, radius: float = COVER_RADIUS) -> float:
    """Return the share of the truly visible points (V, 3) that have a cloud point within `radius` metres.

    The visible points are thinned to one a 3 mm voxel, so that the share is one of area, not of pixels.
    """
    from scipy.spatial import cKDTree

    if not len(visible):
        return float("nan")
    _, first = np.unique(np.floor(visible / 0.003).astype(int), axis=0, return_index=True)
    return float((cKDTree(points).query(visible[first])[0] <= radius).mean())


def hull_volume_ratio(scene: Scene, mesh: "trimesh.Trimesh") -> float:
    """Return the volume of the cloud's completed hull over that of the true hull."""
    hull = cloud_hull(scene.target.points, scene.plane)
    return float("nan") if hull is None else float(hull.volume / mesh.convex_hull.volume)


def object_geoms(model: "mujoco.MjModel", body: str = "object") -> NDArray[np.int64]:
    """Return the ids of a body's geoms."""
    return np.flatnonzero(model.geom_bodyid == model.body(body).id)
