"""Record of a planned grasp, as its file will hold it."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.grasp import RAISED, Grasp
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.probability import probability_of
from dexgrasp.grasp.record import (
    APPROACH,
    LIFT,
    PLACING,
    Contact,
    GraspRecord,
    Neighbour,
    Phase,
    Script,
    as_json,
    conventions,
)
from dexgrasp.grasp.thresholds import thresholds_for
from dexgrasp.grasp.trajectory import ActionScript, bend, stray
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env import __version__
from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.objects.model import Solid
from dexgrasp_env.scene.constants import CONTROL_PERIOD


@dataclass(frozen=True)
class Origin:
    """Provenance of a grasp: agent, seed and seconds, nothing that can be checked."""

    agent: str = ""
    seed: int = 0
    planning_seconds: float | None = None


@dataclass(frozen=True)
class ObjectPose:
    """Pose of the true object: the planner has not seen it, but the file lets everybody check what it took it for.

    Attributes:
        surface: of the object.
        T_world_object: (4, 4).
    """

    surface: Solid
    T_world_object: Array

    def hull_offset(self, target: GraspTarget) -> Array:
        """Return the volume centroid of the planned hull less that of the true object's hull, (3,) m."""
        R, p = self.T_world_object[:3, :3], self.T_world_object[:3, 3]
        return target.distance.hull_volume()[1] - (R @ self.surface.hull_centre + p)


def planned_record(
    name: str | ObjectIdentity, grasp: Grasp, target: GraspTarget, settings: Any, *,
    script: ActionScript | None = None, pose: ObjectPose | None = None, origin: Origin | None = None,
) -> GraspRecord:  # fmt: skip
    """Return the record of a planned grasp.

    Args:
        name: which object, or only what to call it.
        grasp: as planned, in the world.
        target: what it was planned on.
        settings: of the planner, for its thresholds.
        script: what will be executed; without it the file has no approach and no lift, and is not verified.
        pose: of the true object, where it is known.
        origin: who planned.
    """
    origin, motion = origin or Origin(), grasp.motion
    torsion = grasp.cell.robot.hand.torsion * grasp.forces[:, 3:].sum(1)
    contacts = zip(grasp.fingers, grasp.contacts, grasp.normals, grasp.forces[:, :3], torsion, strict=True)
    record = GraspRecord(
        **vars(origin),
        **conventions(grasp.cell),
        here=grasp.cell,
        mount=grasp.cell.robot.mount.name,
        object=_with_known(ObjectIdentity(name) if isinstance(name, str) else name, target),
        T_world_object=None if pose is None else pose.T_world_object,
        hull_offset=None if pose is None else pose.hull_offset(target),
        parts=target.distance.corners,
        centre=target.centre,
        thresholds=thresholds_for(settings, grasp.cell.robot.hand),
        q=grasp.q,
        pregrasp=motion.pregrasp,
        grasp=motion.grasp,
        squeeze=motion.squeeze,
        contacts=tuple(Contact(name, p, n, f, float(turn)) for name, p, n, f, turn in contacts),
        neighbours=tuple(Neighbour(None, np.eye(4), parts) for parts in target.neighbours),
        script=None if script is None else _executed(script, grasp),
        certificate=grasp.certificate,
        holds_probability=None,
        table=grasp.cell.table,
        request=target.demand.request or None,
    )
    return replace(record, holds_probability=probability_of(record, target.guessed(grasp.normals)))


def grasp_json(record: GraspRecord) -> Fields:
    """Return the JSON object of a grasp (lengths m, angles rad, forces N, frame of the robot's base)."""
    created = datetime.now(UTC).isoformat(timespec="seconds")
    return as_json(record) | {"version": __version__, "created": created}


def _with_known(identity: ObjectIdentity, target: GraspTarget) -> ObjectIdentity:
    """Add what the planner was told of the object, rather than assumed from its shape."""
    moved = np.abs(target.centre - target.distance.volume_centre()).max() > 1e-9
    centre = target.centre if moved else None
    return replace(identity, known_mass=target.known_mass, known_centre=centre)


def _executed(script: ActionScript, grasp: Grasp) -> Script:
    tree = robot_tree(grasp.cell)
    lift = np.concatenate([grasp.motion.squeeze[None], script.phases[LIFT]])
    R, p = map(np.array, zip(*(palm_frame(q, tree) for q in lift), strict=True))
    ways = {name: script.way(name) for name in (APPROACH, *PLACING) if name in script.phases}
    approach, *after = (_phase(name, rows, bend(rows)) for name, rows in ways.items())
    return Script(RAISED, (approach, _phase(LIFT, lift, stray(p, R)), *after))


def _phase(name: str, rows: Array, measure: float) -> Phase:
    return Phase(name, np.round(np.arange(len(rows)) * CONTROL_PERIOD, 9), rows, measure)
