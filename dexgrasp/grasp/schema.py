"""Schema 3 of grasp files, both ways: a record as JSON holds it, and back (`docs/grasp-file.md`).

The file is in the frame of the robot's base, records are in the world's: straight above or below it by the table's
height.
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from dexgrasp.grasp.certificate import Certificate
from dexgrasp.grasp.conventions import STATED
from dexgrasp.grasp.grasp import Grasp, GraspMotion
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.record import GraspRecord, Neighbour, Origin, Phase
from dexgrasp.grasp.thresholds import Thresholds
from dexgrasp.grasp.values import array, convex_parts, items, number, positive, word
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import shifted
from dexgrasp_env.robot.active import of_process
from dexgrasp_env.robot.robot import Robot

SCHEMA = 3
MEASURES = {"approach": "bend", "lift": "stray"}
"""The phases of a script, and what the file says of each."""
_MOST_ROWS, _MOST_CONTACTS, _MOST_NEIGHBOURS = 10_000, 20, 100
_SETPOINTS = ("pregrasp", "grasp", "squeeze")


def as_json(record: GraspRecord) -> dict[str, Any]:
    """Return a record as schema 3 holds it (lengths m, angles rad, forces N, frame of the robot's base)."""
    grasp, base = record.grasp, _base(record.conventions)
    pose, offset = record.T_world_object, record.hull_offset
    contacts = zip(grasp.fingers, grasp.contacts - base, grasp.normals, grasp.forces, strict=True)
    return {
        "schema": SCHEMA,
        **vars(record.origin),
        **{name: record.conventions[name] for name in STATED},
        "mount": grasp.mount,
        "object": record.object.as_json(base),
        "T_world_object": None if pose is None else shifted(pose, -base).tolist(),
        "hull_offset": None if offset is None else offset.tolist(),
        "parts": [(part - base).tolist() for part in record.parts],
        "centre": (record.centre - base).tolist(),
        "thresholds": record.thresholds.as_json(),
        "q": grasp.q.tolist(),
        **{name: getattr(grasp.motion, name).tolist() for name in _SETPOINTS},
        "contacts": [
            {"finger": finger, "point": point.tolist(), "normal": normal.tolist(), "force": force.tolist()}
            for finger, point, normal, force in contacts
        ],
        "neighbours": [
            {"name": n.name, "pose": shifted(n.pose, -base).tolist(), "parts": [p.tolist() for p in n.parts]}
            for n in record.neighbours
        ],
        "script": {"lift_height": grasp.motion.lift_height, "phases": [_phase_json(p) for p in record.phases]}
        if record.phases
        else None,
        "certificate": grasp.certificate.as_json(),
        "holds_probability": record.holds_probability,
    }


def _phase_json(phase: Phase) -> dict[str, Any]:
    rows = {"times": phase.times.tolist(), "setpoints": phase.setpoints.tolist()}
    return {"name": phase.name, **rows, MEASURES[phase.name]: phase.measure}


def parse(content: dict[str, Any]) -> GraspRecord:
    """Return the record of a JSON object of schema 3.

    Raises:
        KeyError, TypeError, ValueError: with what is missing or malformed.
    """
    robot = of_process(word("mount", content["mount"])).robot
    stated = {name: content[name] for name in STATED}
    for name in ("name", "hash"):
        word(f"robot {name}", stated["robot"][name])
    base = _base(stated | {"table_height": number("table_height", stated["table_height"])})
    identity = ObjectIdentity.of_json(content["object"], base)
    pose, offset = content["T_world_object"], content["hull_offset"]
    if (pose is None) != (offset is None) or (pose is not None and identity.content_hash is None):
        raise ValueError(
            "T_world_object, hull_offset and the object's content_hash go together: all, or none of them"
        )
    script, chance = content["script"], content["holds_probability"]
    phases = (
        () if script is None else tuple(_phase(p, robot.dof) for p in items("phases", script["phases"], 2, 2))
    )
    if phases and tuple(phase.name for phase in phases) != tuple(MEASURES):
        raise ValueError(f"the phases of a script are {', '.join(MEASURES)}, in this order")
    return GraspRecord(
        object=identity,
        grasp=_grasp(content, base, robot),
        parts=tuple(part + base for part in convex_parts("parts", content["parts"])),
        centre=array("centre", content["centre"], (3,)) + base,
        thresholds=_thresholds(content["thresholds"]),
        T_world_object=None if pose is None else shifted(array("T_world_object", pose, (4, 4)), base),
        hull_offset=None if offset is None else array("hull_offset", offset, (3,)),
        phases=phases,
        neighbours=tuple(
            _neighbour(n, base) for n in items("neighbours", content["neighbours"], 0, _MOST_NEIGHBOURS)
        ),
        holds_probability=None if chance is None else _share("holds_probability", chance),
        origin=Origin(word("agent", content["agent"]), content["seed"], content["planning_seconds"]),
        conventions=stated,
    )


def _grasp(content: dict[str, Any], base: Array, robot: Robot) -> Grasp:
    contacts = items("contacts", content["contacts"], 2, _MOST_CONTACTS)
    points, normals, forces = (
        np.array([array(f"{key} of a contact", contact[key], (3,)) for contact in contacts])
        for key in ("point", "normal", "force")
    )
    q, pregrasp, grasp, squeeze = (array(name, content[name], (robot.dof,)) for name in ("q", *_SETPOINTS))
    motion, script = GraspMotion(pregrasp, grasp, squeeze), content["script"]
    if script is not None:
        motion = replace(motion, lift_height=number("lift_height", script["lift_height"]))
    fingers = tuple(contact["finger"] for contact in contacts)
    if any(finger not in robot.columns for finger in fingers) or len(set(fingers)) < len(fingers):
        raise ValueError(f"the fingers of contacts must be different ones of {', '.join(robot.columns)}")
    return Grasp(
        q=q,
        contacts=points + base,
        normals=normals,
        forces=forces,
        certificate=_certificate(content["certificate"], len(contacts)),
        motion=motion,
        mount=robot.mount.name,
        fingers=fingers,
    )


def _neighbour(value: dict[str, Any], base: Array) -> Neighbour:
    name = None if value["name"] is None else word("name of a neighbour", value["name"])
    pose = shifted(array("pose of a neighbour", value["pose"], (4, 4)), base)
    return Neighbour(convex_parts("parts of a neighbour", value["parts"]), pose, name)


def _thresholds(value: dict[str, Any]) -> Thresholds:
    low, high = array("distance", value["distance"], (2,))
    others = [f.name for f in fields(Thresholds) if f.name != "distance"]
    for name in ("friction", "friction_hold"):
        positive(name, value[name])
    return Thresholds(
        distance=(float(low), float(high)), **{name: number(name, value[name]) for name in others}
    )


def _certificate(value: dict[str, Any], contacts: int) -> Certificate:
    if not isinstance(value["holds"], bool):
        raise ValueError("holds must be true or false")
    distances = array("distances_cm", value["distances_cm"], (contacts,))
    positive("mass", value["mass"])
    others = [f.name for f in fields(Certificate) if f.name not in ("distances_cm", "holds")]
    claims = {name: number(name, value[name]) for name in others}
    return Certificate(distances_cm=tuple(distances.tolist()), holds=value["holds"], **claims)


def _phase(value: dict[str, Any], joints: int) -> Phase:
    name = word("name of a phase", value["name"])
    rows = items(f"setpoints of {name}", value["setpoints"], 2, _MOST_ROWS)
    times = array(f"times of {name}", value["times"], (len(rows),))
    setpoints = array(f"setpoints of {name}", rows, (len(rows), joints))
    measure = MEASURES.get(name, "measure")
    return Phase(name, times, setpoints, number(f"{measure} of {name}", value[measure]))


def _share(name: str, value: Any) -> float:
    found = number(name, value)
    if not 0.0 <= found <= 1.0:
        raise ValueError(f"{name} is {found}: valid is null, or from 0 to 1")
    return found


def _base(stated: Mapping[str, Any]) -> Array:
    """Where the robot's base stands in the world, (3,) m."""
    return np.array([0.0, 0.0, 0.0 - stated["table_height"]])
