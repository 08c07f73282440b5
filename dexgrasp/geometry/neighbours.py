"""Convex parts of the neighbours of a target: hulls of objects, columns of walls."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from dexgrasp.geometry.completion import completed_corners
from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.target import PART_FACES, Parts
from dexgrasp_env.arrays import Array, box_corners, middle
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.cloud import cells_of, thinned
from dexgrasp_env.perception.neighbourhoods import linked
from dexgrasp_env.perception.scene import ObjectCloud, Scene
from dexgrasp_env.poses import about_z

SEEN, UNSEEN = 0.003, 0.006
"""m by which a neighbour's sides are taken to lie farther out: those that were seen, and those that no camera saw."""
_LEAST = 3  # points that are near each other: fewer are noise
_SIDE = 0.03  # m of the squares of columns
_THICK = 0.004  # m that a column reaches at least to either side of its middle


def neighbours_of(scene: Scene, give: float = 0.0) -> tuple[Parts, ...]:
    """Return the corners (N, 3) m of the convex parts of each neighbour; the last are those of what is no object.

    A neighbour is the hull of its cloud down to the table; where that holds a part of the target, the neighbour is
    hollow or reaches around it, and the columns that its points stand in take the hull's place.

    Args:
        scene: what is seen, `without_splinters`.
        give: m that neighbours, which are loose, may be pushed: by so much they are taken for smaller. What is no
            object stays as it is.
    """
    found = [tuple(_smaller(part, give) for part in _parts(one, scene)) for one in scene.neighbours]
    found.append(columns(scene.rest.points) + scene.boxes)
    most = 60  # parts of a neighbour, as a grasp file takes them
    return tuple(parts[k : k + most] for parts in found for k in range(0, len(parts), most))


def points_around(scene: Scene) -> Array:
    """Return points (N, 3) m, one a centimetre and 5000 at most, that the parts of neighbours are made to hold."""
    clouds = *scene.neighbours, scene.rest
    found = np.concatenate([_together(one.points, _SIDE) for one in clouds])
    found = found[thinned(found, 0.01)]
    return found[:: max(1, -(-len(found) // 5000))]


def without_splinters(scene: Scene) -> Scene:
    """Return a scene of whose points of no object those within the target's hull are left out."""
    rest = scene.rest
    hull = completed_corners(scene.target, scene.plane)[0] if len(rest) >= _LEAST else None
    if hull is None:
        return scene
    outside = ConvexDistance.from_points(hull, PART_FACES).distance(rest.points) > SEEN
    return replace(scene, rest=ObjectCloud(rest.points[outside], rest.normals[outside]))


def _parts(cloud: ObjectCloud, scene: Scene) -> Parts:
    hull = completed_corners(cloud, scene.plane)[0]
    if hull is not None:
        with suppress(InputError):  # points that lie in a plane
            distance = ConvexDistance.from_points(_grown(hull, cloud), PART_FACES)
            # A hull that holds points of the target 6 mm deep is not the neighbour's shape.
            if distance.distance(scene.target.points).min() >= -0.006:
                return distance.corners
    return columns(cloud.points)


def _grown(corners: Array, cloud: ObjectCloud) -> Array:
    """Add to corners (N, 3) m the points that trimming left out, and all of it moved out to all sides and up."""
    sides = about_z(np.pi * np.arange(8) / 4)[:, :, 0]  # level directions in which a neighbour may be grown
    # cosine of the angle to a side within which a normal shows that it was seen
    grown = np.where((cloud.normals @ sides.T > 0.5).any(axis=0), SEEN, UNSEEN)
    corners = np.concatenate([corners, cloud.points])
    level = np.concatenate([corners + step * side for step, side in zip(grown, sides, strict=True)])
    higher = 0.002  # m
    return np.concatenate([level, level[level[:, 2] > level[:, 2].min() + higher] + [0.0, 0.0, higher]])


def _smaller(corners: Array, give: float) -> Array:
    """Return corners (N, 3) m of a part whose sides and top are `give` m farther in, its foot where it was."""
    if not give:
        return corners
    foot = np.array([*middle(corners)[:2], corners[:, 2].min()])
    half = np.ptp(corners, axis=0) * [0.5, 0.5, 1.0]
    return foot + np.maximum(half - give, np.minimum(half, _THICK)) / half * (corners - foot)


def columns(points: Array) -> Parts:
    """Return the corners of boxes around points (N, 3) m, one for each square that holds some, and `SEEN` beyond.

    They stand on the table, but for what is seen far above it, which hangs.
    """
    hang = points[:, 2] > 0.55  # m above the table from where on points hang
    return (*_boxes(points[~hang], _SIDE, 0.0), *_boxes(points[hang], 0.10))  # m, side of their columns


def _boxes(points: Array, side: float, foot: float | None = None) -> Parts:
    """Return the boxes of columns: from their lowest points on, or from the height of a foot, m."""
    points, boxes = _together(points, side), list[Array]()
    squares = cells_of(points[:, :2], side)
    for square in np.unique(squares):
        held = points[squares == square]
        centre, half = middle(held), np.maximum(0.5 * np.ptp(held, axis=0) + SEEN, _THICK)
        low, high = centre - half, centre + half
        low[2] = low[2] if foot is None else foot
        boxes.append(box_corners(low, high))
    return tuple(boxes)


def _together(points: Array, step: float) -> Array:
    """Return those of points (N, 3) m of which some are linked by steps of `step` m: fewer are noise."""
    pieces = linked(points, step) if len(points) else np.zeros(0, int)
    return points[np.bincount(pieces)[pieces] >= _LEAST]
