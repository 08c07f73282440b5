"""A grasp as read from a file: what it holds, checked for shape and sense but not yet for truth."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.thresholds import Thresholds
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.active import active_cell
from dexgrasp_env.robot.cell import SIMULATED
from dexgrasp_env.robot.mounts import MOUNTS
from dexgrasp_env.robot.names import GRASP_FINGERS, JOINTS

SCHEMA = 2
FRAME = "robot_base"
UNITS = {"length": "m", "angle": "rad", "force": "N", "mass": "kg", "time": "s"}
OUTSIDE = ["close", "hold"]
"""Phases that run on feedback from the joints, so that no certificate can cover them."""
CONVENTIONS: dict[str, Any] = {
    "frame": FRAME, "units": UNITS, "joint_names": list(JOINTS), "finger_order": list(GRASP_FINGERS),
    "outside_certificate": OUTSIDE, "cell": active_cell().stamp, "table_height": active_cell().table_height,
}  # fmt: skip
"""What every file of schema 2 states in the same words."""
_ARRAYS = {
    "q": (23,), "pregrasp": (23,), "grasp": (23,), "squeeze": (23,), "contacts": (3, 3), "normals": (3, 3),
    "forces": (3, 3), "centre": (3,),
}  # fmt: skip
_PLACES = ("contacts", "centre")
CLAIMS: dict[str, tuple[int, ...]] = {
    "distances_cm": (3,), "force_ratio_percent": (), "torque_ratio_percent": (), "closure_residual": (),
    "closure_margin": (), "min_clearance_m": (), "joint_limit_margin_rad": (), "max_joint_torque_fraction": (),
    "hold_residual": (), "mass": (), "load": (), "capacity": (), "friction": (),
}  # fmt: skip
"""Numbers of the certificate and their shapes."""
_CLAIMS_1 = (
    "distances_cm",
    "closure_margin",
    "min_clearance_m",
    "joint_limit_margin_rad",
    "max_joint_torque_fraction",
)
_OF_SCHEMA_1 = ("friction", "friction_hold", "distance", "tip_radius", "closure_margin", "clearance")
_LARGEST = 1e6  # in SI units: no number of a grasp is nearly as large, and squares of larger ones overflow
_FLAT = 1e-6  # m: a hull thinner than this has no inside
_MOST_ROWS, _MOST_VERTICES, _MOST_PARTS = 10_000, 100_000, 64


@dataclass(frozen=True)
class Segment:
    """Set-points with their times.

    Attributes:
        times: (T,) s.
        setpoints: (T, 23) rad.
        measure: what the file says of the way: `bend` of an approach, rad, `stray` of a lift, m (see `path`).
    """

    times: Array
    setpoints: Array
    measure: float


@dataclass(frozen=True)
class GraspRecord:
    """A grasp as read from a file; world frame (the file's is the robot's base), m, rad, N.

    Attributes:
        object: which object it is of.
        mount: of the hand.
        arrays: `q`, `pregrasp`, `grasp`, `squeeze` (23,), `contacts`, `normals`, `forces` (3, 3), `centre` (3,).
        parts: vertices (V, 3) of each convex part that was planned on; mostly one, the hull.
        thresholds: that the file asks to be held to.
        certificate: what the planner claims.
        T_world_object: (4, 4) of the true object, where the file knows it.
        hull_offset: (3,) m, volume centroid of the planned hull less that of the true object's hull, where known.
        approach: from home to the pregrasp; None where the file lacks it.
        lift: from the squeeze up; None where the file lacks it.
        lift_height: m.
        conventions: frame, units, orders and names as the file states them.
        agent: who planned.
        schema: of the file.
    """

    object: ObjectIdentity
    mount: str
    arrays: dict[str, Array]
    parts: tuple[Array, ...]
    thresholds: Thresholds
    certificate: dict[str, Any]
    T_world_object: Array | None = None
    hull_offset: Array | None = None
    approach: Segment | None = None
    lift: Segment | None = None
    lift_height: float = 0.0
    conventions: Mapping[str, Any] | None = None
    agent: str = ""
    schema: int = SCHEMA

    @property
    def hull(self) -> Array:
        """(V, 3) m, vertices whose convex hull is that of all parts."""
        return np.concatenate(self.parts)

    def check_cell(self) -> None:
        """Refuse a grasp of another cell, where the same joint angles are another place.

        Raises:
            InputError: naming both cells.
        """
        planned = (self.conventions or {}).get("cell", SIMULATED)
        if planned != active_cell().stamp:
            raise InputError(
                f"the grasp was planned for cell {planned!r}, and this is {active_cell().stamp!r}: "
                "give its --cell file"
            )

    @property
    def mass(self) -> float:
        """Kg that the certificate is about."""
        return float(self.certificate["mass"])


def parse(content: dict[str, Any]) -> GraspRecord:
    """Return the record of a JSON object of schema 2.

    Raises:
        KeyError, TypeError, ValueError: with what is missing or malformed.
    """
    conventions = _conventions(content)
    base = np.array([0.0, 0.0, 0.0 - float(array("table_height", conventions["table_height"], ()))])
    identity = _identity(content["object"], base)
    pose, offset = content["T_world_object"], content["hull_offset"]
    if (pose is None) != (offset is None) or (pose is not None and identity.content_hash is None):
        raise ValueError(
            "T_world_object, hull_offset and the object's content_hash go together: all, or none of them"
        )
    return GraspRecord(
        object=identity, mount=_mount(content["mount"]),
        arrays={name: array(name, content[name], shape) + (base if name in _PLACES else 0.0)
                for name, shape in _ARRAYS.items()},
        parts=tuple(part + base for part in _parts(content["hull_vertices"], content.get("part_sizes"))),
        thresholds=_thresholds(content["thresholds"]),
        certificate=_certificate(content["certificate"], CLAIMS),
        T_world_object=None if pose is None else shifted(array("T_world_object", pose, (4, 4)), base),
        hull_offset=None if offset is None else array("hull_offset", offset, (3,)),
        approach=_segment("approach", content["approach"], "bend"), lift=_segment("lift", content["lift"], "stray"),
        lift_height=0.0 if content["lift"] is None else positive("lift height", content["lift"]["height"]),
        conventions=conventions, agent=_word("agent", content["agent"]),
    )  # fmt: skip


def parse_1(content: dict[str, Any]) -> GraspRecord:
    """Return the record of a JSON object of schema 1, without what that lacked; errors as in `parse`."""
    certificate = _certificate(content["certificate"], {name: CLAIMS[name] for name in _CLAIMS_1})
    limits = {name: content["thresholds"][name] for name in _OF_SCHEMA_1}
    pose = content.get("T_world_object")
    return GraspRecord(
        object=ObjectIdentity(str(content["object"])[:200]), mount=_mount(content["mount"]),
        arrays={name: array(name, content[name], shape) for name, shape in _ARRAYS.items()},
        parts=(_hull(content["hull_vertices"]),), thresholds=_thresholds(Thresholds().as_json() | limits),
        certificate=certificate | {"mass": positive("mass", content["mass"])},
        T_world_object=None if pose is None else array("T_world_object", pose, (4, 4)), schema=1,
    )  # fmt: skip


def shifted(T: Array, by: Array) -> Array:
    """Return a pose (4, 4) moved by (3,) m."""
    moved = T.copy()
    moved[:3, 3] += by
    return moved


def array(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return finite numbers of a shape.

    Raises:
        ValueError: for anything else.
    """
    try:
        found = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be numbers of shape {shape}") from None
    if found.shape != shape or _has_words(value):
        raise ValueError(f"{name} must be numbers of shape {shape}, not {found.shape}")
    if not (np.abs(found) < _LARGEST).all():
        raise ValueError(f"{name} must be finite numbers below {_LARGEST:.0e}")
    return found


def positive(name: str, value: Any) -> float:
    """Return a finite number above 0, or raise ValueError."""
    number = float(array(name, value, ()))
    if number <= 0.0:
        raise ValueError(f"{name} must be above 0, not {number}")
    return number


def _has_words(value: Any) -> bool:
    """Whether text or truth values pass for numbers ("1.0" and true are not numbers)."""
    if isinstance(value, list):
        return any(_has_words(item) for item in value)
    return isinstance(value, str | bool)


def _word(name: str, value: Any) -> str:
    if not isinstance(value, str) or len(value) > 4096:
        raise ValueError(f"{name} must be a word")
    return value


def _conventions(content: dict[str, Any]) -> dict[str, Any]:
    """What the file states; one without a cell, or its table, was written before there were others."""
    stated = {"cell": SIMULATED, "table_height": 0.0} | content
    return {name: stated[name] for name in CONVENTIONS}


def _mount(value: Any) -> str:
    if _word("mount", value) not in MOUNTS:
        raise ValueError(f"mount must be one of {', '.join(MOUNTS)}")
    return str(value)


def _identity(value: Any, base: Array) -> ObjectIdentity:
    known = {f.name: value[f.name] for f in fields(ObjectIdentity)}
    words = {n: None if known[n] is None else _word(n, known[n]) for n in ("source", "content_hash")}
    if (words["source"] is None) != (words["content_hash"] is None):
        raise ValueError("the object's source and content_hash go together: both, or none")
    mass, centre = known["known_mass"], known["known_centre"]
    if centre is not None:
        x, y, z = array("known_centre", centre, (3,)) + base
        centre = (float(x), float(y), float(z))
    return ObjectIdentity(
        _word("object name", known["name"]), words["source"], positive("object scale", known["scale"]),
        words["content_hash"], None if mass is None else positive("known_mass", mass), centre,
    )  # fmt: skip


def _parts(value: Any, sizes: Any) -> tuple[Array, ...]:
    """The parts' vertices, one after the other; without sizes they are those of one hull."""
    if sizes is None:
        return (_hull(value),)
    whole = isinstance(sizes, list) and all(type(n) is int and n >= 4 for n in sizes)
    if (
        not whole
        or not 2 <= len(sizes) <= _MOST_PARTS
        or not isinstance(value, list)
        or sum(sizes) != len(value)
    ):
        raise ValueError(
            f"part_sizes must be null or the vertices of 2 to {_MOST_PARTS} parts, hull_vertices in all"
        )
    ends = np.cumsum(sizes).tolist()
    return tuple(_hull(value[end - n : end]) for n, end in zip(sizes, ends, strict=True))


def _hull(value: Any) -> Array:
    if not isinstance(value, list) or not 4 <= len(value) <= _MOST_VERTICES:
        raise ValueError("hull_vertices must be (V, 3) finite numbers with V >= 4")
    hull = array("hull_vertices", value, (len(value), 3))
    if np.linalg.svd(hull - hull.mean(0), compute_uv=False)[2] < _FLAT:
        raise ValueError("hull_vertices must enclose a volume")
    return hull


def _thresholds(value: Any) -> Thresholds:
    found: dict[str, Any] = {}
    for field in fields(Thresholds):
        if field.name == "distance":
            low, high = array("distance", value["distance"], (2,))
            found["distance"] = (float(low), float(high))
        elif field.name == "pad_cosine":
            found["pad_cosine"] = float(array("pad_cosine", value["pad_cosine"], ()))
        elif field.name in ("closure_margin", "clearance"):
            found[field.name] = float(array(field.name, value[field.name], ()))
        else:
            found[field.name] = positive(field.name, value[field.name])
    return Thresholds(**found)


def _certificate(value: Any, claims: dict[str, tuple[int, ...]]) -> dict[str, Any]:
    found: dict[str, Any] = {
        name: array(name, value[name], shape) if shape else float(array(name, value[name], shape))
        for name, shape in claims.items()
    }
    positive("mass", found.get("mass", 1.0))
    if "friction" in claims and not isinstance(value["holds"], bool):
        raise ValueError("holds must be true or false")
    return found | {"holds": value.get("holds")}


def _segment(name: str, value: Any, measure: str) -> Segment | None:
    if value is None:
        return None
    rows = value["setpoints"]
    if not isinstance(rows, list) or not 2 <= len(rows) <= _MOST_ROWS:
        raise ValueError(f"{name} must have 2 to {_MOST_ROWS} setpoints")
    times = array(f"{name} times", value["times"], (len(rows),))
    setpoints = array(f"{name} setpoints", rows, (len(rows), 23))
    return Segment(times, setpoints, float(array(f"{name} {measure}", value[measure], ())))
