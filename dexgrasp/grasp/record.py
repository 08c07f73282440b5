"""Schema 3 of grasp files: what each field is, and what it may be (`docs/grasp-file.md`).

A record is checked for shape and sense when it is read, not yet for truth.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from dexgrasp.geometry.request import Goal, GraspRequest
from dexgrasp.grasp.certificate import Certificate
from dexgrasp.grasp.field_types import Number, Parts, Pose, Positive, Row, Share, Vector, Word
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.thresholds import Thresholds
from dexgrasp_env.arrays import Array, Fields, array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import jsonable
from dexgrasp_env.poses import placed
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.table import SeenTable
from dexgrasp_env.valid import list_of, number, one_of

SCHEMA = 3
APPROACH, LIFT = "approach", "lift"
PLACING = ("carry", "set_down", "release", "retreat")
"""The phases of a script; the last four of one that sets the object down."""


@dataclass(frozen=True)
class RobotName:
    """A robot by its name, and a hash of all that its files say."""

    name: str
    hash: str


def conventions(cell: Cell) -> Fields:
    """Return what a grasp file states for a cell, by field."""
    return {
        "frame": "robot_base",
        "units": {"length": "m", "angle": "rad", "force": "N", "mass": "kg", "time": "s"},
        # These run on feedback from the joints, so that no certificate can cover them.
        "outside_certificate": ["close", "hold"],
        "cell": cell.name,
        "robot": RobotName(cell.robot.name, cell.robot.hash),
        "table_height": cell.table_height,
        "joint_names": list(cell.robot.joints),
    }


@dataclass(frozen=True)
class Contact:
    """A fingertip on the object.

    Attributes:
        finger: whose tip it is.
        point: (3,) m, on the surface that was planned on.
        normal: (3,) unit, out of the object.
        force: (3,) N on the object.
        torsion: Nm on the object, about the normal, of soft tips.
    """

    finger: Word
    point: Vector
    normal: Vector
    force: Vector
    torsion: Number = 0.0


@dataclass(frozen=True)
class Phase:
    """Set-points with their times.

    Attributes:
        name: `approach`, from home to the pregrasp, `lift`, from the squeeze up, or one of `PLACING`.
        times: (T,) s.
        setpoints: (T, n) rad.
        measure: of the way: `trajectory.stray` of a lift, m, `trajectory.bend` of the others, rad.
    """

    name: Annotated[str, one_of((APPROACH, LIFT, *PLACING))]
    times: Row
    setpoints: Annotated[Array, array(None, None)]
    measure: Number


@dataclass(frozen=True)
class Script:
    """Motion that is executed open loop: approach and lift; between them fingers close and press on feedback."""

    lift_height: Annotated[float, number(gt=0, le=0.5)]
    phases: Annotated[tuple[Phase, ...], list_of(Phase, 2, 6, more=True)]


@dataclass(frozen=True)
class Neighbour:
    """An object beside the one that is grasped, an obstacle.

    Attributes:
        name: None where it is not known.
        pose: (4, 4) of a frame of its own; identity where only a cloud was seen.
        parts: vertices (V, 3) m of its convex parts in that frame.
    """

    name: Word | None
    pose: Pose
    parts: Parts


@dataclass(frozen=True)
class Chance:
    """A probability, with the 95 % interval of the members of the model that states it."""

    value: Share
    low: Share
    high: Share


@dataclass(frozen=True)
class HoldsProbability:
    """Probability that the grasp holds, by a model that was fitted on episodes (`probability.probability_of`).

    Attributes:
        model: hash of its file.
        friction: coefficient of the surfaces.
        mass: kg of the object.
        guessed: m, mean error expected of the surface at the contacts where no camera saw it; else 0.
        lifted: to be lifted and held for 3 s.
        pushed: to be held through pushes by its weight from six sides as well.
    """

    model: Word
    friction: Positive
    mass: Positive
    guessed: Annotated[float, number(ge=0, le=1)]
    lifted: Chance
    pushed: Chance


@dataclass(frozen=True, eq=False)
class GraspRecord:
    """A grasp as a file holds it, but in the world frame (the file's is the robot's base); m, rad, N.

    Attributes:
        agent, seed, planning_seconds: who planned, with which seed, how long: provenance.
        here: the cell that it was read or planned in, with its mount; in no file.
        frame, units, outside_certificate, cell, robot, table_height, joint_names: see `conventions`.
        mount: of the hand.
        object: which object it is of.
        T_world_object: (4, 4) of the true object, where the file knows it.
        hull_offset: (3,) m, volume centroid of the planned hull less that of the true object's hull, where known.
        parts: vertices (V, 3) of each convex part that was planned on; mostly one, the hull.
        centre: (3,) of mass that was planned with.
        thresholds: that the file asks to be held to.
        q, pregrasp, grasp, squeeze: (n,) the configuration, and set-points: open, in contact, pressing.
        contacts: any number.
        neighbours: what stands around the object.
        script: what is executed; None where the grasp was planned without a start.
        certificate: what the planner claims.
        holds_probability: of being lifted and held; None where no model says one.
        table: where the table was seen that all keeps clear of, frame of the robot's base; None where it is the cell's.
        request: what was asked of the grasp, frame of the robot's base; None for nothing.
    """

    agent: Word
    seed: int
    planning_seconds: float | None
    here: Cell
    frame: Word
    units: dict[str, str]
    outside_certificate: list[str]
    cell: Word
    robot: RobotName
    table_height: Number
    joint_names: list[str]
    mount: Word
    object: ObjectIdentity
    T_world_object: Pose | None
    hull_offset: Vector | None
    parts: Parts
    centre: Vector
    thresholds: Thresholds
    q: Row
    pregrasp: Row
    grasp: Row
    squeeze: Row
    contacts: Annotated[tuple[Contact, ...], list_of(Contact, 2, 20, more=True)]
    neighbours: Annotated[tuple[Neighbour, ...], list_of(Neighbour, 0, 100, more=True)]
    script: Script | None
    certificate: Certificate
    holds_probability: HoldsProbability | None
    table: SeenTable | None = None
    request: GraspRequest | None = None

    def __post_init__(self) -> None:
        """Check that the fields go together.

        Raises:
            InputError: naming those that do not.
        """
        robot, known = self.here.robot, self.T_world_object is not None
        joints = robot.dof
        rows = [self.q, self.pregrasp, self.grasp, self.squeeze]
        phases = () if self.script is None else self.script.phases
        fits = {
            f"q, pregrasp, grasp and squeeze have {joints} numbers": all(len(row) == joints for row in rows),
            f"phases are {APPROACH} and {LIFT}, and {', '.join(PLACING)} with a goal alone": [
                p.name for p in phases
            ]
            in ([], [APPROACH, LIFT, *(PLACING if self.goal else ())]),
            f"phases have 2 or more setpoints of {joints} numbers, and as many times": all(
                p.setpoints.shape == (len(p.times), joints) and len(p.times) >= 2 for p in phases
            ),
            "distances_cm has a number for each contact": len(self.certificate.distances_cm)
            == len(self.contacts),
            f"contacts are of different fingers of {', '.join(robot.columns)}": set(self.fingers)
            <= set(robot.columns)
            and len(set(self.fingers)) == len(self.contacts),
            "T_world_object, hull_offset and the object's content_hash go together": known
            == (self.hull_offset is not None)
            and (self.object.content_hash is not None or not known),
            "the object's source and content_hash go together": (self.object.source is None)
            == (self.object.content_hash is None),
        }
        for rule, kept in fits.items():
            if not kept:
                raise InputError(f"it does not fit together: valid is where {rule}")

    @property
    def goal(self) -> Goal | None:
        """Place that the object is set down at; None where it is held."""
        return None if self.request is None else self.request.goal

    @property
    def fingers(self) -> tuple[str, ...]:
        """Names of the fingers that make the contacts."""
        return tuple(contact.finger for contact in self.contacts)

    @property
    def points(self) -> Array:
        """Contacts (N, 3) m."""
        return np.array([contact.point for contact in self.contacts])

    @property
    def normals(self) -> Array:
        """Normals (N, 3) out of the object."""
        return np.array([contact.normal for contact in self.contacts])

    @property
    def forces(self) -> Array:
        """Forces (N, c) N on the object; of soft tips the fourth part is their torsion over its radius."""
        forces, radius = np.array([contact.force for contact in self.contacts]), self.here.robot.hand.torsion
        if not radius:
            return forces
        return np.c_[forces, [contact.torsion / radius for contact in self.contacts]]

    @property
    def neighbour_parts(self) -> list[Array]:
        """Corners (V, 3) m of the convex parts of all neighbours, world frame."""
        return [placed(n.pose, part) for n in self.neighbours for part in n.parts]

    @property
    def stated_cell(self) -> Cell:
        """The cell with its table where the file says that it is."""
        return replace(self.here, table_height=self.table_height).seeing(self.table)

    def check_cell(self) -> Cell:
        """Return the cell that it is carried out in.

        Raises:
            InputError: where the grasp is of another cell: the same joint angles would be another place.
        """
        planned, here = (
            f"{of['cell']!r} ({of['robot'].name}-{of['robot'].hash}, table at {of['table_height']:g} m)"
            for of in (vars(self), conventions(self.here))
        )
        if planned != here:
            raise InputError(
                f"the grasp was planned for cell {planned}, and this is {here}: give its file with --robot"
            )
        return self.here

    def placed(self, T: Array) -> "GraspRecord":
        """Return it in a frame in which its own has pose `T` (4, 4)."""
        R, pose, centre = T[:3, :3], self.T_world_object, self.object.known_centre
        contacts = (
            replace(one, point=placed(T, one.point), normal=R @ one.normal, force=R @ one.force)
            for one in self.contacts
        )
        return replace(
            self,
            object=replace(self.object, known_centre=None if centre is None else placed(T, centre)),
            T_world_object=None if pose is None else T @ pose,
            hull_offset=None if self.hull_offset is None else R @ self.hull_offset,
            parts=tuple(placed(T, part) for part in self.parts),
            centre=placed(T, self.centre),
            contacts=tuple(contacts),
            neighbours=tuple(replace(n, pose=T @ n.pose) for n in self.neighbours),
        )


def as_json(record: GraspRecord) -> Fields:
    """Return a record as schema 3 holds it (lengths m, angles rad, forces N, frame of the robot's base)."""
    stated = vars(record.placed(record.stated_cell.T_base_world)) | {"schema": SCHEMA}
    del stated["here"]
    if record.request is None:
        del stated["request"]
    found = jsonable(stated)
    if record.table is not None and not len(record.table.around):
        del found["table"]["around"]
    return found
