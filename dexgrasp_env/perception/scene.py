"""Scene of a table: the target, its neighbours, the table, the cameras.

Simulated cameras, recorded clouds and observations of the environment all end in a `Scene`; planning begins with one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Arrays, Mask
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.cloud import pad
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.poses import placed
from dexgrasp_env.robot.table import SeenTable

REST = -1
"""The label of points that belong to no object."""


def _none() -> Array:
    return np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class ObjectCloud:
    """The points of one object.

    Attributes:
        points: (N, 3) m, world frame.
        normals: (N, 3) out of the object, none longer than 1; zeros where they are unknown.
        pixels: (N,) of each point in the flattened (cameras, H, W) images; empty where there are none.
        doubt: why it may be two objects, a part of the next, or of another shape, for people; empty without doubt.
        foot: m over the table of what it stands on, where that is another thing.
    """

    points: Array = field(default_factory=_none)
    normals: Array = field(default_factory=_none)
    pixels: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    doubt: str = ""
    foot: float = 0.0

    def __post_init__(self) -> None:
        points, normals = (np.asarray(values, dtype=float) for values in (self.points, self.normals))
        if points.ndim != 2 or points.shape[1:] != (3,) or normals.shape != points.shape:
            raise InputError(f"points {points.shape} and normals {normals.shape}: valid are (N, 3) both")
        if not np.isfinite(points).all():
            raise InputError("the points of an object must be finite numbers")
        normals = np.nan_to_num(normals, posinf=0.0, neginf=0.0)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        # 1.001: the longest unit vector in single precision.
        normals = np.where(length > 1.001, normals / np.maximum(length, 1.0), normals)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "normals", normals)

    def __len__(self) -> int:
        return len(self.points)

    def placed(self, T: Array) -> "ObjectCloud":
        """Return it in a frame in which its own has pose `T` (4, 4), in single precision as observations hold it."""
        points, normals = placed(T, self.points), self.normals @ T[:3, :3].T
        return replace(self, points=points.astype(np.float32), normals=normals.astype(np.float32))

    def stands_on(self, table: Plane | None) -> Plane | None:
        """Return the plane that the object stands on, None where the table is not known."""
        return None if table is None else replace(table, offset=table.offset + self.foot)


@dataclass(frozen=True, eq=False)
class Scene:
    """A table as it is seen, or the reason why nothing can be said of it.

    Attributes:
        target: the object that is meant; no points where there is a reason.
        plane: the table, or None.
        reason: why there is no target, in a word that can be counted; None with one.
        sentence: the same for people, with figures; empty where the word is all there is.
        neighbours: other objects, each by itself.
        rest: what belongs to no object, e.g. walls.
        boxes: corners (8, 3) m of boxes that are kept clear of as well: wide levels, what hangs over the table.
        cameras: (K, 4, 4) T_world_camera as they are believed to be; none where they are unknown.
        note: in words, what people should know of how it was read.
        table: where it was seen, which is where the world is then (`Cell.seeing`); None: where the cell has it.
    """

    target: ObjectCloud = field(default_factory=ObjectCloud)
    plane: Plane | None = None
    reason: str | None = None
    sentence: str = ""
    neighbours: tuple[ObjectCloud, ...] = ()
    rest: ObjectCloud = field(default_factory=ObjectCloud)
    boxes: tuple[Array, ...] = ()
    cameras: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))
    note: str = ""
    table: SeenTable | None = None

    def __post_init__(self) -> None:
        if np.shape(self.cameras)[1:] != (4, 4):
            raise InputError(f"cameras {np.shape(self.cameras)}: valid are poses (K, 4, 4)")

    def standing_on(self, table: SeenTable, T: Array) -> "Scene":
        """Return it in the world of a table that was seen, in which its own has pose `T` (4, 4)."""
        target, rest, *neighbours = (one.placed(T) for one in (self.target, self.rest, *self.neighbours))
        boxes = tuple(placed(T, box) for box in self.boxes)
        plane = None if self.plane is None else self.plane.placed(T)
        return replace(
            self,
            target=target,
            rest=rest,
            boxes=boxes,
            neighbours=tuple(neighbours),
            plane=plane,
            table=table,
        )

    @classmethod
    def of_observation(cls, observation: Mapping[str, Any], info: Mapping[str, Any] | None = None) -> "Scene":
        """Return what an observation of a cloud shows, points that are not numbers left out.

        Args:
            observation: of obs_mode `pointcloud`; normals and plane may be missing.
            info: the public info at reset; None where there is none.

        Raises:
            InputError: where the observation has no cloud.
        """
        if not {"cloud", "cloud_mask"} <= observation.keys():
            raise InputError(
                "this agent plans from a point cloud: make the environment with obs_mode='pointcloud'"
            )
        (points, normals, finite), known = _read(observation, "cloud"), info or {}
        counts = np.asarray(observation["cloud_mask"], dtype=bool) & finite
        neighbours, rest = _read_neighbours(observation)
        return cls(
            ObjectCloud(points[counts], normals[counts]),
            Plane.from_array(observation.get("table_plane", np.zeros(5))),
            known.get("perception_failure") or None,
            neighbours=neighbours,
            rest=rest,
            cameras=np.asarray(known.get("perception_T_world_camera", np.zeros((0, 4, 4))), dtype=float),
        )

    def as_observation(self, count: int, neighbour_rows: int = 0) -> Arrays:
        """Return the arrays that `of_observation` reads.

        Args:
            count: rows of points of the target, a mask saying which hold one.
            neighbour_rows: points of what stands around it, labels saying of what: a neighbour's number, from 1 on,
                `REST` for the rest, 0 for no point. None where it is 0.
        """
        target = _written("cloud", self.target.points, self.target.normals, count) | {
            "cloud_mask": (np.arange(count) < len(self.target)).astype(np.int8),
            "table_plane": Plane.to_array(self.plane).astype(np.float32),
        }
        if not neighbour_rows:
            return target
        # Of neighbours and rest, thinned evenly where there are more than `neighbour_rows` points.
        clouds = [*self.neighbours, self.rest]
        points, normals = (
            np.concatenate([getattr(c, name) for c in clouds]) for name in ("points", "normals")
        )
        labels = np.array([*range(1, len(clouds)), REST], np.int16).repeat([len(cloud) for cloud in clouds])
        kept = slice(None, None, max(1, -(-len(points) // neighbour_rows)))
        return (
            target
            | _written("around", points[kept], normals[kept], neighbour_rows)
            | {"around_labels": pad(labels[kept], neighbour_rows)}
        )


def _written(name: str, points: Array, normals: Array, count: int) -> Arrays:
    """Return points and normals (N, 3) as `count` rows of an observation."""
    return {
        name: pad(points.astype(np.float32), count),
        f"{name}_normals": pad(normals.astype(np.float32), count),
    }


def _read(observation: Mapping[str, Any], name: str) -> tuple[Array, Array, Mask]:
    """Return points and normals (N, 3) of an observation, normals 0 where it has none, and which are numbers (N,)."""
    points = np.asarray(observation[name], dtype=float)
    normals = np.asarray(observation.get(f"{name}_normals", np.zeros_like(points)), dtype=float)
    return points, normals, np.isfinite(points).all(axis=1)


def _read_neighbours(observation: Mapping[str, Any]) -> tuple[tuple[ObjectCloud, ...], ObjectCloud]:
    """Return neighbours and rest of an observation, none where it holds none."""
    if "around" not in observation:
        return (), ObjectCloud()
    points, normals, finite = _read(observation, "around")
    labels = np.where(finite, observation["around_labels"], 0)
    numbers = [*np.unique(labels[labels > 0]), REST]
    *neighbours, rest = (ObjectCloud(points[labels == k], normals[labels == k]) for k in numbers)
    return tuple(neighbours), rest
