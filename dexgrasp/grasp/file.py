"""A grasp as a JSON file: all that will be executed and all that is claimed of it (`docs/grasp-file.md`)."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.grasp.grasp import Grasp
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.path import bend, stray
from dexgrasp.grasp.record import CONVENTIONS, SCHEMA, GraspRecord, parse, parse_1, shifted
from dexgrasp.grasp.script import ActionScript
from dexgrasp.grasp.thresholds import thresholds_for
from dexgrasp.shape.target import GraspTarget, assumed_mass, hull_volume, volume_centre
from dexgrasp_env import __version__
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_atomically
from dexgrasp_env.objects.solid import Solid
from dexgrasp_env.robot.active import active_cell
from dexgrasp_env.scene.constants import CONTROL_PERIOD

_LARGEST = 64 << 20  # bytes of a file that is read


def grasp_json(
    name: str | ObjectIdentity, grasp: Grasp, target: GraspTarget, settings: Any, *,
    script: ActionScript | None = None, pose: "ObjectPose | None" = None, agent: str = "", seed: int = 0,
    planning_seconds: float | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Return the JSON object of a grasp (lengths m, angles rad, forces N, frame of the robot's base).

    Args:
        name: which object, or only what to call it.
        grasp: as planned, in the world.
        target: what it was planned on.
        settings: of the planner, for its thresholds.
        script: what will be executed; without it the file has no approach and no lift, and is not verified.
        pose: of the true object, where it is known.
        agent: who planned.
        seed: it planned with.
        planning_seconds: it took.
    """
    identity, base = ObjectIdentity(name) if isinstance(name, str) else name, active_cell().base
    return {
        "schema": SCHEMA, "version": __version__, "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "agent": agent, "seed": seed, "planning_seconds": planning_seconds,
        **CONVENTIONS,
        "mount": grasp.mount,
        "object": {**identity.as_json(), **_known(target, base)},
        "T_world_object": None if pose is None else shifted(pose.T_world_object, -base).tolist(),
        "hull_offset": None if pose is None else pose.hull_offset(target).tolist(),
        **_shape(target, base),
        "centre": (target.centre - base).tolist(),
        "thresholds": thresholds_for(settings).as_json(),
        "q": grasp.q.tolist(),
        "pregrasp": grasp.motion.pregrasp.tolist(),
        "grasp": grasp.motion.grasp.tolist(),
        "squeeze": grasp.motion.squeeze.tolist(),
        "approach": None if script is None else _approach(script),
        "lift": None if script is None else _lift(script, grasp),
        "contacts": (grasp.contacts - base).tolist(),
        "normals": grasp.normals.tolist(),
        "forces": grasp.forces.tolist(),
        "certificate": grasp.certificate.as_json(),
    }  # fmt: skip


def _shape(target: GraspTarget, base: Array) -> dict[str, Any]:
    """The corners of all parts, and where there are several, how many are each one's."""
    corners = {"hull_vertices": (np.concatenate(target.corners) - base).tolist()}
    sizes = [len(part) for part in target.corners]
    return corners if len(sizes) == 1 else {**corners, "part_sizes": sizes}


class ObjectPose:
    """Where the true object is: the planner has not seen it, but the file lets everybody check what it took it for."""

    def __init__(self, surface: Solid, T_world_object: Array) -> None:
        """Take the object's surface and its pose (4, 4)."""
        self._surface, self.T_world_object = surface, np.asarray(T_world_object, dtype=float)

    def hull_offset(self, target: GraspTarget) -> Array:
        """Return the volume centroid of the planned hull less that of the true object's hull, (3,) m."""
        R, p = self.T_world_object[:3, :3], self.T_world_object[:3, 3]
        return hull_volume(target.distance)[1] - (R @ self._surface.hull_centre + p)


def _known(target: GraspTarget, base: Array) -> dict[str, Any]:
    """What the planner was told of the object, rather than assumed from its shape."""
    told = abs(target.mass - assumed_mass(hull_volume(target.distance)[0])) > 1e-9
    moved = np.abs(target.centre - volume_centre(target.distance)).max() > 1e-9
    return {
        "known_mass": target.mass if told else None,
        "known_centre": (target.centre - base).tolist() if moved else None,
    }


def _approach(script: ActionScript) -> dict[str, Any]:
    rows = np.concatenate([script.start[None], script.targets[: dict(script.phases)["close"]]])
    return {"bend": bend(rows), **_timed(rows)}


def _lift(script: ActionScript, grasp: Grasp) -> dict[str, Any]:
    from dexgrasp.kinematics.palm_ik import palm_frame
    from dexgrasp.kinematics.tree import robot_tree

    first = dict(script.phases)
    rows = np.concatenate([grasp.motion.squeeze[None], script.targets[first["lift"] : first["hold"]]])
    palms = [palm_frame(q, robot_tree(grasp.mount)) for q in rows]
    strayed = stray(np.array([p for _, p in palms]), np.array([R for R, _ in palms]))
    return {"height": grasp.motion.lift_height, "stray": strayed, **_timed(rows)}


def _timed(rows: Array) -> dict[str, Any]:
    times = np.round(np.arange(len(rows)) * CONTROL_PERIOD, 9)
    return {"times": times.tolist(), "setpoints": rows.tolist()}


def write_grasp(path: Path, content: dict[str, Any]) -> None:
    """Write a grasp file, whole or not at all."""
    write_atomically(path, (json.dumps(content, indent=1) + "\n").encode())


def read_grasp(path: Path) -> GraspRecord:
    """Read a grasp file.

    Raises:
        InputError: if it is missing, not JSON, of another schema, or a field is missing or malformed.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError(f"{path} is not a grasp file: it has more than {_LARGEST >> 20} MiB")
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, RecursionError):  # no text, no JSON, a number of too many digits, nested too deep
        raise InputError(f"{path} is not a grasp file: it holds no JSON (was it cut off?)") from None
    return record_of(content, str(path))


def record_of(content: Any, source: str = "this object") -> GraspRecord:
    """Return the grasp of a JSON object, as `grasp_json` or `plan --json` make it; errors as in `read_grasp`."""
    if isinstance(content, dict) and isinstance(content.get("grasp"), dict):
        content = content["grasp"]  # the output of `plan --json`
    parsers = {SCHEMA: parse, 1: parse_1}
    schema = content.get("schema") if isinstance(content, dict) else None
    if not isinstance(schema, int) or isinstance(schema, bool) or schema not in parsers:
        raise InputError(
            f"{source} is not a grasp of schema {SCHEMA} (or 1), as `dexgrasp plan --out` writes it"
        )
    try:
        return parsers[schema](content)
    except KeyError as error:
        raise InputError(f"{source} is not a usable grasp: {error} is missing") from None
    except (TypeError, ValueError, AttributeError, RecursionError) as error:
        text = " ".join(str(error).split())[:300]
        raise InputError(f"{source} is not a usable grasp: {text}") from None
