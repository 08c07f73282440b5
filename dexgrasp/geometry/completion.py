"""From a scene to the planner's target: the hull of its cloud, the side that no camera saw completed, its parts.

A network completes the side from the one that was seen, as numbers in a frame of its own. All of them are support
functions: h(d) = max d . x over the points, for fixed directions d.
"""

from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.convex_parts import MOST_PARTS, parts_within
from dexgrasp.geometry.hull import cloud_corners, trim_extremes
from dexgrasp.geometry.target import PART_FACES, GraspTarget, Uncertainty
from dexgrasp.runs.weights import Layer, layers_of, read_arrays, relu, through
from dexgrasp_env.arrays import Array, Single, middle
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.perception.scene import ObjectCloud, Scene
from dexgrasp_env.poses import about_z

NO_CLOUD, NO_VOLUME = "empty_cloud", "cloud_has_no_volume"
_LEAST_POINTS = 4
UNIT = 0.1
"""m: lengths are read and written in this unit."""
ONE_SIDED = 0.4
"""From here on normals point one way: with four cameras up to 0.27 was measured, with one the median is 0.86."""


class NoTarget(Exception):  # noqa: N818  (it is an outcome, not a defect)
    """A scene that shows nothing to grasp: why, in a word that can be counted."""


def target_of(scene: Scene, mass: float | None = None, parts: int = MOST_PARTS) -> GraspTarget:
    """Return the object that a scene shows.

    Args:
        scene: what is seen; the plane is the table on which the object stands.
        mass: kg; assumed if None.
        parts: convex ones, at most, that an object which is not convex is planned on.

    Raises:
        NoTarget: with the scene's reason, or where its points span no volume to speak of.
    """
    if scene.reason is not None:
        raise NoTarget(scene.reason)
    if len(scene.target) < _LEAST_POINTS:
        raise NoTarget(NO_CLOUD)
    hull, uncertainty = completed_corners(scene.target, scene.plane)
    if hull is None:
        raise NoTarget(NO_VOLUME)
    convex, airy = [hull], False
    if uncertainty is None:
        convex, airy = parts_within(hull, scene.target.points, scene.target.stands_on(scene.plane), parts)
    try:
        target = GraspTarget.of_corners(convex, mass=mass, uncertainty=uncertainty)
    except InputError:
        raise NoTarget(NO_VOLUME) from None
    if uncertainty is not None and scene.plane is not None:
        return replace(target, near=_nearest_guess(scene.target, scene.plane))
    return replace(target, seen=scene.target.points.astype(float)) if airy else target


def _nearest_guess(cloud: ObjectCloud, plane: Plane) -> ConvexDistance | None:
    """Return the least that an object may be, what was seen with walls straight down; None if it is flat."""
    plane = replace(plane, offset=plane.offset + cloud.foot)
    feet = cloud.points - plane.heights(cloud.points)[:, None] * plane.normal
    with suppress(InputError):
        return ConvexDistance.from_points(np.concatenate([cloud.points, feet]), PART_FACES)
    return None


@lru_cache(maxsize=64)  # of a target it is asked for by the list of objects, the plan and what stands around
def completed_corners(cloud: ObjectCloud, plane: Plane | None) -> tuple[Array | None, Uncertainty | None]:
    """Return the corners (N, 3) m of the hull of what a cloud shows, and the uncertainty of one that was completed.

    A cloud whose normals do not all point one way shows the object all round: they are `cloud_corners`.

    Args:
        cloud: of the object alone.
        plane: the table; None completes nothing. The hull ends on it, or at the object's foot.
    """
    points, normals, plane = cloud.points, cloud.normals, cloud.stands_on(plane)
    if plane is not None and len(points) >= _LEAST_POINTS and one_sidedness(normals) >= ONE_SIDED:
        view = VisibleSide.of(points, normals, plane)
        support, error = _completed(view)
        corners = _corners(support)
        if corners is not None:
            whole = cloud_corners(corners * UNIT @ view.R + view.origin)
            return whole, Uncertainty(WRITTEN @ view.R, error)
    return cloud_corners(points, plane), None


def guesses_said(scene: Scene) -> Scene:
    """Return a scene whose objects say, as a doubt, where a guessed side is taken to make their section much larger."""
    target, *others = (_guess_said(one, scene.plane) for one in (scene.target, *scene.neighbours))
    return replace(scene, target=target, neighbours=tuple(others))


def _guess_said(cloud: ObjectCloud, plane: Plane | None) -> ObjectCloud:
    corners, uncertainty = completed_corners(cloud, plane)
    if corners is None or uncertainty is None or plane is None:
        return cloud
    ratio = _section(corners) / _section(trim_extremes(cloud.points, plane.rms))
    if ratio < 1.3:  # of the section of what was seen, from which on that of a completed object is doubtful
        return cloud
    said = f"has a side that no camera saw: its section is taken to be {ratio:.1f} times what was seen"
    return replace(cloud, doubt="; ".join(filter(None, (cloud.doubt, said))))


def _section(points: Array) -> float:
    """Return the area, m2, of points (N, 3) seen from above."""
    return float(ConvexHull(points[:, :2]).volume)


def _corners(support: Array) -> Array | None:
    """Return corners (N, 3), UNIT, of what lies within a support (361,) and above the table; None if nothing does."""
    from scipy.optimize import linprog

    normals = np.concatenate([WRITTEN, [[0.0, 0.0, -1.0]]])
    most = np.append(support, 0.0)
    # The centre of the largest ball inside: half-spaces are cut around it.
    ball = linprog([0.0, 0.0, 0.0, -1.0], np.c_[normals, np.ones(len(normals))], most, bounds=(None, None))
    # Where the largest ball inside has a radius below 3 mm, there is no volume to speak of.
    if not ball.success or ball.x[3] < 0.003 / UNIT:
        return None
    try:
        corners = HalfspaceIntersection(np.c_[normals, -most], ball.x[:3]).intersections
    except QhullError:
        return None
    return corners[np.isfinite(corners).all(1)]


def one_sidedness(normals: Array) -> float:
    """Return |sum| / sum || of the level parts of normals (N, 3): near 0 seen all round, near 1 from one side."""
    level = normals[:, :2]
    return float(np.linalg.norm(level.sum(0)) / max(float(np.linalg.norm(level, axis=1).sum()), 1e-9))


def even_directions(azimuths: int, elevations: tuple[float, ...]) -> Array:
    """Return unit directions (N, 3): rings of evenly spaced azimuths at elevations in degrees, and straight up."""
    azimuth, elevation = np.meshgrid(2.0 * np.pi * np.arange(azimuths) / azimuths, np.radians(elevations))
    level = np.cos(elevation)
    rings = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)
    return np.concatenate([rings.reshape(-1, 3), [[0.0, 0.0, 1.0]]])


READ = even_directions(24, (-35.0, 0.0, 25.0, 55.0))
"""(97, 3) directions in which the seen side is read."""
WRITTEN = even_directions(40, (-50.0, -25.0, -10.0, 0.0, 10.0, 20.0, 30.0, 45.0, 65.0))
"""(361, 3) directions in which the whole object is written."""


class VisibleSide(NamedTuple):
    """Points and normals in the frame of the view: origin on the table amid the points, z up, x along a face.

    x is the level direction, within 45 degrees of the viewer's, that normals favour up to quarter turns: the walls of a
    box then lie exactly in directions that are read and written.
    """

    points: Array  # (N, 3) UNIT
    normals: Array  # (N, 3)
    R: Array  # (3, 3) rotation, world frame to that of the view
    origin: Array  # (3,) m, world frame
    viewer: float  # rad, where the normals point on the whole, from x

    @classmethod
    def of(cls, points: Array, normals: Array, plane: Plane) -> "VisibleSide":
        """Look at points (N, 3) m with outward normals (N, 3), both in the world frame."""
        level = normals[:, :2]
        length = np.linalg.norm(level, axis=1)
        viewer = np.arctan2(level[:, 1].sum(), level[:, 0].sum())
        turn = (level[:, 0] + 1j * level[:, 1]) / np.maximum(length, 1e-9)
        face = np.angle((length**2 * turn**4).sum()) / 4.0
        face += np.round((viewer - face) / (np.pi / 2.0)) * np.pi / 2.0
        R = about_z(-face)
        amid = middle(points)
        origin = amid - plane.heights(amid) * plane.normal
        return cls((points - origin) @ R.T / UNIT, normals @ R.T, R, origin, float(viewer - face))

    def features(self) -> Array:
        """Return what the network reads, (391,)."""
        along = self.points @ READ.T
        most = along.max(0)
        below = most - np.quantile(along, (0.9, 0.5), axis=0)
        # how narrowly a direction looks at normals: half at 23 degrees
        facing = (np.maximum(self.normals @ READ.T, 0.0) ** 8).mean(0)
        rest = [np.cos(self.viewer), np.sin(self.viewer), np.log(len(self.points)) / 5.0]
        return np.concatenate([most, *below, facing, rest])


def _completed(view: VisibleSide) -> tuple[Array, Array]:
    """Return the whole object's support (361,) in the directions `WRITTEN`, UNIT, and its spread (361,), m.

    The spread is the mean absolute error that the network expects of itself.
    """
    mean, scale, layers = _network()
    x = ((view.features() - mean) / scale).astype(np.float32)
    more, log_spread = np.split(through(layers, x, relu).astype(float), [len(WRITTEN)])
    unit = 0.01  # m: the network answers in this unit
    seen = (view.points @ WRITTEN.T).max(0)
    return seen + more * unit / UNIT, unit * np.exp(np.clip(log_spread, -4.0, 3.0))


@lru_cache(maxsize=1)
def _network() -> tuple[Single, Single, tuple[Layer, ...]]:
    """Return mean and scale (391,) of the features that the shipped perceptron was trained on, and its layers."""
    arrays, _ = read_arrays(asset_path("weights/unseen.safetensors"))
    return arrays["mean"], arrays["scale"], layers_of(arrays, "network")
