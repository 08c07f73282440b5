"""JSON files of grasps: the plain format for any hand (docs/scoring.md), and our own of arm and hand."""

from collections.abc import Sequence
from pathlib import Path

from dexgrasp.evaluation.scoring.closing import SERVO_KP, close_around
from dexgrasp.evaluation.scoring.hand import ALLEGRO, FloatingGrasp, HandModel, HandStage, find_hand
from dexgrasp.evaluation.scoring.readers.fields import FileFields
from dexgrasp.evaluation.scoring.readers.objects import ReadOptions, named_object, pose_of_centre
from dexgrasp.grasp.file import record_of
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import rigid
from dexgrasp_env.robot.cell import Cell, make_cell

FORMAT = "dexgrasp-floating-grasps-1"


def read_plain(content: Fields, path: Path, options: ReadOptions) -> list[FloatingGrasp]:
    """Return the grasps of a file in the plain format.

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
        target = named_object(str(grasp.get("object")), scale, options, path)
        pose = pose_of_centre(grasp.pose("T_world_object"), target)
        found.append(
            FloatingGrasp(grasp.source, hand, target, pose, *_stages(grasp, hand, names, pose[:3, 3]))
        )
    return found


def _hand(content: FileFields, path: Path) -> str:
    """Return the hand's name, or its path, which may be relative to the file."""
    hand = str(content.get("hand")) if "hand" in content else ALLEGRO
    beside = path.parent / hand
    return str(beside) if beside.is_file() else hand


def _stages(
    grasp: FileFields, hand: HandModel, names: list[str], centre: Array
) -> tuple[HandStage, HandStage, HandStage, float | None]:
    """Return pregrasp, grasp and squeeze, and the gain, Nm/rad, that the squeeze is made for."""

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
    """Reorder joint values (..., n) from the order of `names` to that of the hand.

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


def read_ours(content: Fields, path: Path, options: ReadOptions) -> list[FloatingGrasp]:
    """Return the grasp of a file of ours, which must have the object's true pose.

    Raises:
        InputError: if the file is unusable, of another cell, read with another hand, knows no true pose, or its object
            is not found.
    """
    if options.hand != ReadOptions.hand:
        raise InputError(f"{path} names its robot: --hand is of files of others, --robot of ours")
    record = record_of(content, str(path), make_cell(options.robot))
    cell = record.check_cell()
    if record.T_world_object is None:
        raise InputError(
            f"{path}: T_world_object is missing: a grasp planned on a cloud alone cannot be simulated"
        )
    identity = record.object
    target = named_object(identity.source or identity.name, identity.scale, options, path)
    first, middle, last = (_stage(cell, q) for q in (record.pregrasp, record.grasp, record.squeeze))
    gains = cell.robot.stiffness[cell.robot.hand_columns]
    hand = find_hand(cell.robot.hand)
    return [FloatingGrasp(str(path), hand, target, record.T_world_object, first, middle, last, gains)]


def _stage(cell: Cell, q: Array) -> HandStage:
    """Return palm pose and hand joints of a configuration (n,) of the robot."""
    tree = robot_tree(cell)
    return HandStage(rigid(*palm_frame(q, tree)), q[tree.arm :].copy())
