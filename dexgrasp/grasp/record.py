"""All that a grasp file holds: checked for shape and sense when it is read, not yet for truth."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dexgrasp.grasp.conventions import conventions, place
from dexgrasp.grasp.grasp import Grasp
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.thresholds import Thresholds
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError


@dataclass(frozen=True)
class Phase:
    """Set-points with their times.

    Attributes:
        name: `approach`, from home to the pregrasp, or `lift`, from the squeeze up.
        times: (T,) s.
        setpoints: (T, 23) rad.
        measure: what the file says of the way: `bend` of an approach, rad, `stray` of a lift, m (see `path`).
    """

    name: str
    times: Array
    setpoints: Array
    measure: float


@dataclass(frozen=True)
class Neighbour:
    """An object beside the one that is grasped, an obstacle.

    Attributes:
        parts: vertices (V, 3) m of its convex parts, in a frame of its own.
        pose: (4, 4) of that frame, world; identity where only a cloud was seen.
        name: None where it is not known.
    """

    parts: tuple[Array, ...]
    pose: Array
    name: str | None = None


@dataclass(frozen=True)
class Origin:
    """Who planned a grasp, with which seed, and in how many seconds: provenance, nothing that can be checked."""

    agent: str = ""
    seed: int = 0
    planning_seconds: float | None = None


@dataclass(frozen=True)
class GraspRecord:
    """A grasp as a file holds it; world frame (the file's is the robot's base), m, rad, N.

    Attributes:
        object: which object it is of.
        grasp: configuration, contacts, forces, set-points, and what is claimed of them.
        parts: vertices (V, 3) of each convex part that was planned on; mostly one, the hull.
        centre: (3,) of mass that was planned with.
        thresholds: that the file asks to be held to.
        T_world_object: (4, 4) of the true object, where the file knows it.
        hull_offset: (3,) m, volume centroid of the planned hull less that of the true object's hull, where known.
        phases: approach and lift; empty where the grasp was planned without a start.
        neighbours: what stands around the object.
        holds_probability: of being lifted and held; None where no model has said one.
        origin: who planned.
        conventions: frame, units, robot and names as the file states them.
    """

    object: ObjectIdentity
    grasp: Grasp
    parts: tuple[Array, ...]
    centre: Array
    thresholds: Thresholds
    T_world_object: Array | None = None
    hull_offset: Array | None = None
    phases: tuple[Phase, ...] = ()
    neighbours: tuple[Neighbour, ...] = ()
    holds_probability: float | None = None
    origin: Origin = Origin()
    conventions: Mapping[str, Any] = field(default_factory=conventions)

    @property
    def hull(self) -> Array:
        """(V, 3) m, vertices whose convex hull is that of all parts."""
        return np.concatenate(self.parts)

    @property
    def mass(self) -> float:
        """Kg that the certificate is about."""
        return self.grasp.certificate.mass

    def phase(self, name: str) -> Phase | None:
        """Return a phase by its name, None where the file lacks it."""
        return next((phase for phase in self.phases if phase.name == name), None)

    def check_cell(self) -> None:
        """Refuse a grasp of another cell, where the same joint angles are another place.

        Raises:
            InputError: naming both cells.
        """
        here = conventions(self.grasp.mount)
        if any(self.conventions[name] != here[name] for name in ("cell", "robot", "table_height")):
            raise InputError(
                f"the grasp was planned for cell {place(self.conventions)}, and this is {place(here)}: "
                "give its --cell file"
            )
