"""A grasp as a JSON file: everything `verify` needs, nothing that has to be trusted to load."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents.grasp.grasp import Grasp
from agents.grasp.target import GraspTarget
from agents.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_atomically
from dexgrasp_env.robot.mounts import MOUNTS

SCHEMA = 1
_SHAPES = {
    "q": (23,), "pregrasp": (23,), "grasp": (23,), "squeeze": (23,), "contacts": (3, 3), "normals": (3, 3),
    "forces": (3, 3), "centre": (3,),
}  # fmt: skip
_CLAIMS: dict[str, tuple[int, ...]] = {
    "distances_cm": (3,), "closure_margin": (), "min_clearance_m": (), "joint_limit_margin_rad": (),
    "max_joint_torque_fraction": (),
}  # fmt: skip
"""What `verify` compares of the certificate, with shapes."""
_FLAT = 1e-6  # m: a hull thinner than this has no inside


@dataclass(frozen=True)
class GraspRecord:
    """A grasp as read from a file; robot base frame, m, rad, N.

    Attributes:
        object: name of what was planned on.
        mount: of the hand.
        arrays: `q`, `pregrasp`, `grasp`, `squeeze` (23,), `contacts`, `normals`, `forces` (3, 3), `centre` (3,).
        hull: vertices (V, 3) of the convex hull that was planned on.
        mass: kg.
        settings: the planner's thresholds.
        certificate: what the planner claims.
        T_world_object: (4, 4) of the true object, where the file knows it.
    """

    object: str
    mount: str
    arrays: dict[str, Array]
    hull: Array
    mass: float
    settings: PlannerSettings
    certificate: dict[str, Any]
    T_world_object: Array | None


def grasp_json(
    name: str,
    grasp: Grasp,
    target: GraspTarget,
    settings: PlannerSettings,
    T_world_object: Array | None = None,
) -> dict[str, Any]:
    """Return the JSON object of a grasp (lengths m, angles rad, forces N, robot base frame)."""
    return {
        "schema": SCHEMA,
        "frame": "robot_base",
        "object": name,
        "mount": grasp.mount,
        "q": grasp.q.tolist(),
        "pregrasp": grasp.motion.pregrasp.tolist(),
        "grasp": grasp.motion.grasp.tolist(),
        "squeeze": grasp.motion.squeeze.tolist(),
        "contacts": grasp.contacts.tolist(),
        "normals": grasp.normals.tolist(),
        "forces": grasp.forces.tolist(),
        "centre": target.centre.tolist(),
        "mass": grasp.certificate.mass,
        "hull_vertices": np.asarray(target.hull.vertices).tolist(),
        "T_world_object": None if T_world_object is None else np.asarray(T_world_object).tolist(),
        "thresholds": {
            "friction": settings.friction,
            "friction_hold": settings.friction_hold,
            "distance": list(settings.distance),
            "tip_radius": settings.tip_radius,
            "closure_margin": settings.closure_margin,
            "clearance": settings.clearance,
        },
        "certificate": grasp.certificate.as_json(),
    }


def write_grasp(path: Path, content: dict[str, Any]) -> None:
    """Write a grasp file, whole or not at all."""
    write_atomically(path, (json.dumps(content, indent=1) + "\n").encode())


def read_grasp(path: Path) -> GraspRecord:
    """Read a grasp file.

    Raises:
        InputError: if it is missing, not JSON, of another schema, or a field is missing or malformed.
    """
    try:
        content = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except (UnicodeDecodeError, json.JSONDecodeError):
        raise InputError(f"{path} is not a grasp file: it holds no JSON (was it cut off?)") from None
    return record_of(content, str(path))


def record_of(content: Any, source: str = "this object") -> GraspRecord:
    """Return the grasp of a JSON object, as `grasp_json` or `plan --json` make it; errors as in `read_grasp`."""
    if isinstance(content, dict) and isinstance(content.get("grasp"), dict):
        content = content["grasp"]  # the output of `plan --json`
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise InputError(f"{source} is not a grasp of schema {SCHEMA}, as `dexgrasp plan --out` writes it")
    try:
        return _parse(content)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{source} is not a usable grasp: {type(error).__name__} {error}") from None


def _parse(content: dict[str, Any]) -> GraspRecord:
    arrays = {name: _array(name, content[name], shape) for name, shape in _SHAPES.items()}
    hull = np.asarray(content["hull_vertices"], dtype=float)
    if hull.ndim != 2 or hull.shape[1] != 3 or len(hull) < 4 or not np.isfinite(hull).all():
        raise ValueError("hull_vertices must be (V, 3) finite numbers with V >= 4")
    if np.linalg.svd(hull - hull.mean(0), compute_uv=False)[2] < _FLAT:
        raise ValueError("hull_vertices must enclose a volume")
    if content["mount"] not in MOUNTS:
        raise ValueError(f"mount must be one of {', '.join(MOUNTS)}")
    settings = _thresholds(content["thresholds"])
    mass, certificate = _positive("mass", content["mass"]), dict(content["certificate"])
    for name, shape in _CLAIMS.items():
        _array(name, certificate[name], shape)
    pose = content.get("T_world_object")
    return GraspRecord(
        str(content["object"]), content["mount"], arrays, hull, mass, settings,
        certificate, None if pose is None else _array("T_world_object", pose, (4, 4)),
    )  # fmt: skip


def _thresholds(limits: dict[str, Any]) -> PlannerSettings:
    low, high = _array("distance", limits["distance"], (2,))
    margin, clearance = (float(_array(name, limits[name], ())) for name in ("closure_margin", "clearance"))
    return PlannerSettings(
        friction=_positive("friction", limits["friction"]),
        friction_hold=_positive("friction_hold", limits["friction_hold"]),
        distance=(float(low), float(high)), tip_radius=_positive("tip_radius", limits["tip_radius"]),
        closure_margin=margin, clearance=clearance,
    )  # fmt: skip


def _positive(name: str, value: Any) -> float:
    number = float(_array(name, value, ()))
    if number <= 0.0:
        raise ValueError(f"{name} must be a positive number")
    return number


def _array(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    array = np.asarray(value, dtype=float)
    if array.shape != shape or not np.isfinite(array).all():
        kind = f"finite numbers of shape {shape}" if shape else "a finite number"
        raise ValueError(f"{name} must be {kind}")
    return array
