"""A plain JSON file for grasps of any hand, documented in docs/scoring.md."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.scoring.candidate import Candidate, HandStage, as_pose, joints_in_order
from dexgrasp.scoring.closing import SERVO_KP, close_around
from dexgrasp.scoring.hand import HandModel, find_hand
from dexgrasp.scoring.readers.objects import ReadOptions, find_object, pose_of_centre
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

FORMAT = "dexgrasp-floating-grasps-1"


def is_plain(content: Any) -> bool:
    """Whether a JSON object says that it is of this format."""
    return isinstance(content, dict) and content.get("format") == FORMAT


def read_plain(path: Path, options: ReadOptions) -> list[Candidate]:
    """Return the grasps of a file.

    Raises:
        InputError: if a field is missing or malformed, or an object is not found.
    """
    content = json.loads(path.read_text())
    try:
        hand = find_hand(options.hand if options.hand != "allegro" else _hand(content, path))
        names = [str(name) for name in content["joint_names"]]
        grasps = list(content["grasps"])
        return [_grasp(grasp, f"{path}[{i}]", path, hand, names, options) for i, grasp in enumerate(grasps)]
    except KeyError as error:
        raise InputError(
            f"{path}: {error.args[0]} is missing (docs/scoring.md describes the format)"
        ) from None
    except (TypeError, AttributeError) as error:
        raise InputError(f"{path} is not of format {FORMAT} ({error})") from None


def _hand(content: Mapping[str, Any], path: Path) -> str:
    """The hand's name, or its path, which may be relative to the file."""
    hand = str(content.get("hand", "allegro"))
    beside = path.parent / hand
    return str(beside) if beside.is_file() else hand


def _grasp(
    grasp: Mapping[str, Any], source: str, path: Path, hand: HandModel, names: list[str], options: ReadOptions
) -> Candidate:
    target = find_object(str(grasp["object"]), float(grasp.get("object_scale", 1.0)), options, path)
    T_world_object = pose_of_centre(as_pose(grasp["T_world_object"], source, "T_world_object"), target)

    def stage(name: str) -> HandStage:
        part = grasp[name]
        T = as_pose(part["T_world_hand"], source, f"{name}.T_world_hand")
        return HandStage(T, joints_in_order(hand, names, np.asarray(part["joints"], dtype=float), source))

    middle, kp = stage("grasp"), grasp.get("servo_kp")
    if "pregrasp" in grasp and "squeeze" in grasp:
        first, last = stage("pregrasp"), stage("squeeze")
    else:
        points, normals = (_vectors(grasp[key], source, key) for key in ("contacts", "normals_in"))
        first, last = close_around(hand, middle, points, normals, T_world_object[:3, 3])
        kp = SERVO_KP
    return Candidate(
        source, hand, target, T_world_object, first, middle, last, None if kp is None else float(kp)
    )


def _vectors(value: Any, source: str, name: str) -> Array:
    found = np.asarray(value, dtype=float)
    if found.ndim != 2 or found.shape[1] != 3 or not np.isfinite(found).all():
        raise InputError(f"{source}: {name} must be (k, 3) finite numbers")
    return found
