"""The table where it was seen: a plane in the frame of the robot's base, and the points that show it.

What is planned keeps clear of that plane, as high and as leaning as it was seen; a cell's `table_height` is only where
it was expected. Gravity is taken along the plane's normal: tables are level, so that what leans is the robot's base, or
the calibration.
"""

from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from dexgrasp_env.arrays import Array, array
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import least_turn, rigid
from dexgrasp_env.valid import Rule, number

_AMID = np.array([0.53, 0.0])  # m, the middle of the workspace: where objects stand
_LEANING = np.radians(1.0)  # from where it is said


def points_between(least: int, most: int) -> Rule:
    """Return the rule of points, so many at least and at most."""

    def validate(value: Any) -> Array:
        points: Array = array(None, 3).validate(value if len(value) else np.zeros((0, 3)))
        if not least <= len(points) <= most:
            raise ValueError
        return points

    return Rule(f"{least} to {most} points (x, y, z)", validate)


@dataclass(frozen=True, eq=False)
class SeenTable:
    """The plane normal . x = offset of a table's top, frame of the robot's base.

    Attributes:
        normal: (3,) unit, upwards.
        offset: m.
        points: (N, 3) m of its top around the object; none of them is above the plane.
        around: (M, 3) m of what was seen to stand on it besides the object.
    """

    normal: Annotated[Array, array(3)]
    offset: Annotated[float, number(ge=-1, le=1)]
    points: Annotated[Array, points_between(3, 1000)]
    around: Annotated[Array, points_between(0, 10_000)] = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        if abs(np.linalg.norm(self.normal) - 1.0) > 1e-6 or self.normal[2] < 0.5:
            raise InputError("the normal of a table is a unit vector that points up")

    @classmethod
    def of(cls, points: Array) -> "SeenTable":
        """Return the lowest plane that no point (N, 3) m is above, parallel to the least-squares plane of all."""
        normal = np.linalg.eigh(np.cov(points.T))[1][:, 0]
        normal = normal * np.sign(normal[2])
        return cls(normal, float((points @ normal).max()), points)

    @property
    def lean(self) -> float:
        """Angle between its normal and the z of the robot's base, rad."""
        return float(np.arccos(min(self.normal[2], 1.0)))

    def height(self, place: Array) -> float:
        """Return the z of the plane, m, at x and y (2,)."""
        return float((self.offset - self.normal[:2] @ place) / self.normal[2])

    def off(self, expected: float) -> float:
        """Return how far it is from where it is expected, m: at the base or in the workspace, where it is less."""
        return min((self.height(at) - expected for at in (np.zeros(2), _AMID)), key=abs)

    def T_world_base(self, expected: float) -> Array:  # noqa: N802
        """Return the pose (4, 4) of the robot's base in the world, whose z = 0 is the plane.

        The world is turned about where the plane is below the base; if that is not where it is `expected`, m, about
        where it is in the middle of the workspace: objects keep their x and y.
        """
        about = np.zeros(2) if abs(self.height(np.zeros(2)) - expected) < 0.02 else _AMID
        foot = np.array([*about, self.height(about)])
        R = least_turn(self.normal, np.array([0.0, 0.0, 1.0]))
        return rigid(R, np.array([*about, 0.0]) - R @ foot)

    def differs(self, expected: float) -> str:
        """Return in words where it is in place of where it is expected, m; empty where that is so."""
        if abs(self._seen_at - expected) < 0.005 and self.lean < _LEANING:
            return ""
        levelled = ", levelled about the object" if self.lean >= _LEANING else ""
        return f"the table is seen at {self}; the cell has {expected:.3f} m: planned as it is seen{levelled}"

    def __str__(self) -> str:
        tilted = f", tilted by {np.degrees(self.lean):.1f} degrees" if self.lean >= _LEANING else ""
        return f"z = {self._seen_at:.3f} m around the object{tilted}"

    @property
    def _seen_at(self) -> float:
        return self.height(self.points[:, :2].mean(0))
