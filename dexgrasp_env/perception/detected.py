"""Detected objects in words and figures, for people who point at one."""

from dataclasses import dataclass

import numpy as np

from dexgrasp_env.arrays import Array, middle
from dexgrasp_env.perception.neighbourhoods import gaps_between
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.poses import placed


@dataclass(frozen=True, eq=False)
class DetectedObject:
    """An object on the table.

    Attributes:
        number: from 1 on; the one that is meant comes first.
        place: (3,) m, the middle of the box around it, in the frame of the robot's base.
        extents: (3,) m, the sides of that box.
        next: m to the nearest of the others; infinity where there is none.
        apart: m to the one that comes first.
        doubtful: whether there is a doubt.
        doubt: why it may be something else, empty without doubt, see `ObjectCloud`.
    """

    number: int
    place: Array
    extents: Array
    next: float
    apart: float
    doubtful: bool = False
    doubt: str = ""

    def __str__(self) -> str:
        return in_words(self.place, self.extents)


def in_words(place: Array, sides: Array) -> str:
    """Return for people where something is, (3,) m, and how large, (3,) m."""
    size = " x ".join(f"{100 * side:.0f}" for side in sides)
    return f"{size} cm at ({', '.join(f'{x:.2f}' for x in place)})"


def detected_objects(scene: Scene, T_base_world: Array) -> list[DetectedObject]:
    """Return the objects that a scene shows, in the frame of the robot's base, in which the world has a pose (4, 4)."""
    shown = [one for one in (scene.target, *scene.neighbours) if len(one)]
    clouds = [one.points for one in shown]
    gaps = np.array(
        [
            [gaps_between(other, own).min() if other is not own else np.inf for other in clouds]
            for own in clouds
        ]
    )
    return [
        DetectedObject(
            k,
            placed(T_base_world, middle(points)),
            np.ptp(points, axis=0),
            float(own.min()),
            float(own[0]),
            bool(one.doubt),
            one.doubt,
        )
        for k, (one, points, own) in enumerate(zip(shown, clouds, gaps, strict=True), start=1)
    ]
