"""A plain JSON file for grasps of any hand, documented in docs/scoring.md."""

from collections.abc import Sequence
from pathlib import Path

from dexgrasp.evaluation.scoring.closing import SERVO_KP, close_around
from dexgrasp.evaluation.scoring.hand import ALLEGRO, Candidate, HandModel, HandStage, find_hand
from dexgrasp.evaluation.scoring.readers.fields import FileFields
from dexgrasp.evaluation.scoring.readers.objects import ReadOptions, find_object, pose_of_centre
from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError

FORMAT = "dexgrasp-floating-grasps-1"


def read_plain(content: Fields, path: Path, options: ReadOptions) -> list[Candidate]:
    """Return the grasps of what a file holds.

    Raises:
        InputError: if a field is missing or malformed, or an object is not found.
    """
    file = FileFields(content, str(path))
    hand = find_hand(_hand(file, path) if options.hand == ALLEGRO else options.hand)
    names, grasps = file.words("joint_names"), file.get("grasps")
    if not isinstance(grasps, list):
        raise InputError(f"{path} is not of format {FORMAT}: grasps must be a list")
    found = []
    for number, value in enumerate(grasps):
        grasp = FileFields(value, f"{path}[{number}]")
        scale = grasp.numbers("object_scale").item(0) if "object_scale" in grasp else 1.0
        target = find_object(str(grasp.get("object")), scale, options, path)
        pose = pose_of_centre(grasp.pose("T_world_object"), target)
        found.append(Candidate(grasp.source, hand, target, pose, *_stages(grasp, hand, names, pose[:3, 3])))
    return found


def _hand(content: FileFields, path: Path) -> str:
    """The hand's name, or its path, which may be relative to the file."""
    hand = str(content.get("hand")) if "hand" in content else ALLEGRO
    beside = path.parent / hand
    return str(beside) if beside.is_file() else hand


def _stages(
    grasp: FileFields, hand: HandModel, names: list[str], centre: Array
) -> tuple[HandStage, HandStage, HandStage, float | None]:
    """Pregrasp, grasp and squeeze, and the gain that the squeeze is meant for."""

    def stage(name: str) -> HandStage:
        """Return the stage of that name."""
        part = FileFields(grasp.get(name), f"{grasp.source}.{name}")
        return HandStage(
            part.pose("T_world_hand"), joints_in_order(hand, names, part.numbers("joints"), part.source)
        )

    middle = stage("grasp")
    if "pregrasp" in grasp and "squeeze" in grasp:
        kp = grasp.numbers("servo_kp").item(0) if "servo_kp" in grasp else None
        return stage("pregrasp"), middle, stage("squeeze"), kp
    points, normals = grasp.vectors("contacts"), grasp.vectors("normals_in")
    if points.shape != normals.shape:
        raise InputError(f"{grasp.source}: contacts and normals_in differ in number")
    first, last = close_around(hand, middle, points, normals, centre)
    return first, middle, last, SERVO_KP


def joints_in_order(hand: HandModel, names: Sequence[str], values: Array, source: str) -> Array:
    """Return joint values (..., n) in the hand's order from values named otherwise ordered.

    Raises:
        InputError: if names are missing, unknown or doubled.
    """
    if values.shape[-1] != len(names):
        raise InputError(f"{source}: joints must be {len(names)} numbers, one for each joint name")
    if sorted(names) != sorted(hand.joint_names):
        strange = sorted(set(names) ^ set(hand.joint_names))
        raise InputError(
            f"{source}: joint names do not fit hand {hand.name} (differing: {', '.join(strange[:4])} "
            f"...): valid are {', '.join(hand.joint_names)}"
        )
    return values[..., [names.index(name) for name in hand.joint_names]]
