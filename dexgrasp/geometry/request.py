"""Requests of a grasp: where its contacts lie, which way its palm faces, what it must bear, where the object goes.

All places are in the frame of the robot's base, whatever the table: a request is stated before anything is seen.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from dexgrasp_env.arrays import Array, array
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import placed
from dexgrasp_env.robot.table import points_between
from dexgrasp_env.valid import (
    POSITIVE,
    Friction,
    Mass,
    Rule,
    Share,
    check_fields,
    number,
    read,
    several,
)

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_MOST_POINTS = 5000
MOST = 10_000
"""Grasps that differ, at most, of one request."""
_GRASPS = number(ge=1, le=MOST, whole=True)._replace(
    words=f"a whole number from 1 to {MOST} (`dexgrasp dataset generate` makes more)"
)
_WAYS = {"top": ((0.0, 0.0, -1.0), 30.0), "front": ((1.0, 0.0, 0.0), 45.0), "side": (None, 30.0)}
"""Name -> the way that the palm faces, None for any level one, and degrees that it may be off."""


@dataclass(frozen=True, eq=False)
class Region:
    """A box, or all that is within a radius of points; frame of the robot's base, m.

    Attributes:
        low, high: (3,) corners of the box; None for points.
        points: (N, 3); None for a box.
        radius: around the points; of a box, by how much it is grown.
    """

    low: Annotated[Array | None, array(3)] = None
    high: Annotated[Array | None, array(3)] = None
    points: Annotated[Array | None, points_between(1, _MOST_POINTS)] = None
    radius: Annotated[float, number(ge=-1, le=1)] = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        boxed = self.low is not None and self.high is not None
        if boxed == (self.points is not None) or (self.low is None) != (self.high is None):
            raise InputError("a region is a box, with low and high, or points with a radius")
        if self.low is not None and self.high is not None and not (self.low < self.high).all():
            raise InputError("a region's box is empty: valid is each of its low numbers below the high one")
        if self.points is not None and not self.radius > 0:
            raise InputError("a region of points has a radius above 0 m")

    @classmethod
    def of_points(cls, points: Array) -> "Region":
        """Return the surroundings of marked points (N, 3) m, thinned where they are many.

        Raises:
            InputError: where there is none.
        """
        if not len(points):
            raise InputError("a region's mask marks no point")
        # What is within 6 mm of a marked point counts as marked: clouds have a point in each 5 mm or so.
        radius = 0.006
        cells = np.unique(np.round(points / (0.5 * radius)), axis=0)
        return cls(points=cells[:: -(-len(cells) // _MOST_POINTS)] * (0.5 * radius), radius=radius)

    def gap(self, points: Array) -> Array:
        """Return how far outside points (N, 3) m are (N,) m; below 0 inside."""
        if self.low is not None and self.high is not None:
            out = np.maximum(self.low - points, points - self.high)
            outside = np.linalg.norm(np.maximum(out, 0.0), axis=1)
            return outside + np.minimum(out.max(1), 0.0) - self.radius
        return self._tree.query(points)[0] - self.radius

    @cached_property
    def _tree(self) -> "cKDTree":
        from scipy.spatial import cKDTree

        return cKDTree(self.points)

    def grown(self, by: float) -> "Region":
        """Return it larger by `by` m on all sides; one that is made smaller than a point stays one."""
        least = -1.0 if self.points is None else 1e-6
        return replace(self, radius=float(np.clip(self.radius + by, least, 1.0)))


def _region(value: Any) -> Region:
    if isinstance(value, Region | Mapping):
        return read(Region, value, "region")
    kind, _, rest = value.partition(":")
    numbers = [float(word) for word in rest.split(",")]
    if not np.isfinite(numbers).all() or len(numbers) != {"box": 6, "sphere": 4}.get(kind):
        raise ValueError
    if kind == "sphere":
        return Region(points=np.array([numbers[:3]]), radius=numbers[3])
    return Region(np.array(numbers[:3]), np.array(numbers[3:]))


REGION = Rule("box:X0,Y0,Z0,X1,Y1,Z1 or sphere:X,Y,Z,RADIUS, m in the frame of the robot's base", _region)
_REGIONS = several(REGION, most=20)


@dataclass(frozen=True, eq=False)
class Approach:
    """The way that the palm faces.

    Attributes:
        direction: (3,) in the frame of the robot's base; None for any level one.
        degrees: by which the palm may face another way.
        name: in words; empty for a direction of numbers.
    """

    direction: Annotated[Array | None, array(3)]
    degrees: Annotated[float, number(gt=0, le=180)]
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.direction is not None:
            size = np.linalg.norm(self.direction)
            if not size > 0:
                raise InputError("the direction of an approach has a length above 0")
            object.__setattr__(self, "direction", self.direction / size)

    def off(self, faces: Array) -> Array:
        """Return by how many degrees (N,) palms that face the ways (N, 3) are off."""
        if self.direction is None:
            return np.degrees(np.arcsin(np.clip(np.abs(faces[:, 2]), 0.0, 1.0)))
        return np.degrees(np.arccos(np.clip(faces @ self.direction, -1.0, 1.0)))

    def __str__(self) -> str:
        numbers = () if self.direction is None else self.direction
        way = self.name or "along " + " ".join(f"{x:.2f}" for x in numbers)
        return f"{way} within {self.degrees:g} degrees"


def _approach(value: Any) -> Approach:
    if isinstance(value, Approach | Mapping):
        return read(Approach, value, "approach")
    name, *rest = value.split(",")
    if name in _WAYS:
        (way, degrees), given = _WAYS[name], [float(word) for word in rest]
        if len(given) > 1:
            raise ValueError
        return Approach(None if way is None else np.array(way), (given or [degrees])[0], name)
    numbers = [float(word) for word in (name, *rest)]
    if len(numbers) not in (3, 4) or not np.isfinite(numbers).all():
        raise ValueError
    return Approach(np.array(numbers[:3]), (numbers[3:] or [30.0])[0])


APPROACH_WORDS = Rule(
    "top, side, front or X,Y,Z, the way that the palm faces, with ,DEGREES behind", _approach
)


def _place(value: Any) -> "Goal":
    if isinstance(value, Goal | Mapping):
        return read(Goal, value, "goal")
    x, y, z, *yaw = (number().validate(each) for each in value)
    if len(yaw) > 1:
        raise ValueError
    return Goal(np.array([x, y, z]), *yaw)


@dataclass(frozen=True, eq=False)
class Goal:
    """Place where the object is to be set down, frame of the robot's base.

    Attributes:
        place: (3,) m, for the middle of its outline from above, and what it then stands on.
        yaw: degrees about the vertical by which it is turned from how it lies; None: any.
    """

    place: Annotated[Array, array(3)]
    yaw: Annotated[float | None, number(ge=-180, le=180)] = None

    def __post_init__(self) -> None:
        check_fields(self)


PLACE_WORDS = Rule("X Y Z, m in the frame of the robot's base, and YAW, degrees, if it likes", _place)


@dataclass(frozen=True, eq=False)
class GraspRequest:
    """Request of a grasp: what is known of the object, and constraints besides that it is held.

    Regions, approach and goal may also be stated as the command line has them.

    Attributes:
        hold: every contact lies in one of these regions; none asks for nothing.
        avoid: no contact lies in any of these.
        approach: the way that the palm faces.
        fingers: that make the contacts, one of the grasps of the hand's file; empty leaves them to the planner.
        max_force: N that each finger may press with along the normal; None for what its joints can.
        friction: coefficient of the object's surface; None for what the planner counts on.
        mass: kg of the object where it is known; None assumes one from its volume.
        min_probability: of being lifted and held, that a grasp must have; None for any.
        count: grasps that differ; None plans one.
        seconds: after which the search ends with what it has; None for a search that does not look at the clock.
        goal: where the object is set down after the lift; None: it is held.
    """

    hold: Annotated[tuple[Region, ...], _REGIONS] = ()
    avoid: Annotated[tuple[Region, ...], _REGIONS] = ()
    approach: Annotated[Approach | None, APPROACH_WORDS] = None
    fingers: Annotated[tuple[str, ...], several(Rule("a finger's name", str))] = ()
    max_force: Annotated[float | None, number(gt=0, le=1000)] = None
    friction: Friction | None = None
    mass: Mass | None = None
    min_probability: Share | None = None
    count: Annotated[int | None, _GRASPS] = None
    seconds: Annotated[float | None, POSITIVE] = None
    goal: Annotated[Goal | None, PLACE_WORDS] = None

    def __post_init__(self) -> None:
        check_fields(self)

    def __bool__(self) -> bool:
        return any(value not in (None, ()) for value in vars(self).values())

    @property
    def constrains(self) -> list[str]:
        """Names of what it asks of the grasp itself, beyond that it holds an object of some mass and friction."""
        names = ("hold", "avoid", "approach", "fingers", "max_force", "goal")
        return [name for name in names if getattr(self, name)]

    def outside(self, points: Array) -> Array:
        """Return how far points (N, 3) m are from where contacts may be (N,) m; 0 or less where they may."""
        out = np.full(len(points), -np.inf)
        if self.hold:
            out = np.min([region.gap(points) for region in self.hold], axis=0)
        for region in self.avoid:
            out = np.maximum(out, -region.gap(points))
        return out


_STEP = 1e-6  # of a unit vector, that slopes are taken over

ANYHOW = GraspRequest()
"""The request that asks for nothing."""


class Demand:
    """A request in a world in which the frame of the robot's base has some pose."""

    def __init__(self, request: GraspRequest, T_base_world: Array) -> None:
        """Take the request and the pose (4, 4) of the world in the base's frame."""
        self.request, self._pose = request, T_base_world

    @property
    def degrees(self) -> float:
        """Half-angle of the cone that palms are to face in; 180 where none is asked for."""
        return 180.0 if self.request.approach is None else self.request.approach.degrees

    def outside(self, contacts: Array) -> Array:
        """Return how far contacts (N, 3) m, world frame, are from where they may be (N,) m; 0 or less if there."""
        return self.request.outside(placed(self._pose, contacts))

    def turned(self, face: Array) -> tuple[float, Array]:
        """Return how far a palm that faces a way (3,), world frame, is outside what is asked, rad; its slope (3,)."""
        off = np.radians(self.off(face + np.vstack([np.zeros(3), _STEP * np.eye(3)])) - self.degrees)
        return float(off[0]), (off[1:] - off[0]) / _STEP

    def off(self, faces: Array) -> Array:
        """Return by how many degrees (N,) palms that face the ways (N, 3), world frame, are off."""
        approach = self.request.approach
        return np.zeros(len(faces)) if approach is None else approach.off(faces @ self._pose[:3, :3].T)


def relaxations(request: GraspRequest) -> dict[str, list[GraspRequest]]:
    """Return by constraint the requests that relax it alone, nearest first, at last without it."""
    approach, most = request.approach, request.max_force
    grown = 0.005, 0.01, 0.02, 0.04, 0.08
    values: dict[str, list[Any]] = {
        "approach": [
            approach and replace(approach, degrees=min(approach.degrees + by, 180.0))
            for by in (15.0, 30.0, 50.0, 80.0, 180.0)
        ],
        "hold": [*(tuple(region.grown(by) for region in request.hold) for by in grown), ()],
        "avoid": [*(tuple(region.grown(-by) for region in request.avoid) for by in grown), ()],
        "fingers": [()],
        "goal": [None],
        "max_force": [*(most and min(by * most, 1000.0) for by in (1.25, 1.6, 2.0, 3.0, 5.0)), None],
    }
    asked = request.constrains
    return {name: [replace(request, **{name: to}) for to in values[name]] for name in values if name in asked}
