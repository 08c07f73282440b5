"""Reader of robot files: an arm's, a hand's, and the robot's that names both; paths in a file are relative to it."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from dexgrasp_env.arrays import Fields
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.files import check_file, expand
from dexgrasp_env.robot.robot import FINGERS, Arm, Hand, Joints, Numbers, Robot
from dexgrasp_env.valid import NAMES, WORD, Names, Word, check, read
from dexgrasp_env.yaml_file import read_yaml

SCHEMA = 1
SETTINGS = tuple(field.name for field in fields(Joints) if field.name != "names")


def read_joints(part: str, given: Mapping[str, Any], names: Names) -> Joints:
    """Return the limits and gains that a mapping states for joints: a number each, or one for all.

    Raises:
        InputError: for what is missing, no number, or of another length.
    """
    each = {
        key: value if isinstance(value, list | tuple) else [value] * len(names)
        for key, value in given.items()
    }
    joints = read(Joints, {"names": names, **each}, part)
    for key in each:
        check_length(f"{part} {key}", getattr(joints, key), len(names))
    if part == "hand" and len(set(joints.stiffness)) > 1:
        raise InputError("hand stiffness differs between joints: valid is one number")
    return joints


def check_length(what: str, values: Numbers, length: int) -> None:
    """Refuse a list of another length."""
    if len(values) != length:
        raise InputError(f"{what} has {len(values)} numbers: valid are {length} finite numbers")


def narrowed(part: str, given: Mapping[str, Any], maker: Joints, home: Numbers) -> Joints:
    """Return joints with the limits and gains that a cell gives for them.

    Raises:
        InputError: for an unknown setting, limits wider than the maker's, or a range that does not hold `home`.
    """
    own = {key: values for key in SETTINGS if (values := getattr(maker, key))}
    for key in given:
        if key not in own:
            raise unknown_name(f"setting of {part}", key, own)
    joints = read_joints(part, {**own, **given}, maker.names)
    for key in own.keys() - {"stiffness", "damping"}:
        sign, most = (-1.0, "least") if key == "lower" else (1.0, "most")
        for joint, (value, bound) in enumerate(zip(getattr(joints, key), own[key], strict=True)):
            if sign * value > sign * bound:
                raise InputError(
                    f"{part} {key} of joint {joint + 1} is {value}: valid is at {most} {bound}, the maker's"
                )
    check_home(part, joints, home)
    return joints


def check_home(part: str, joints: Joints, home: Numbers) -> None:
    """Refuse ranges that do not hold home."""
    check_length(f"{part} home", home, len(joints.names))
    for joint, (low, q, high) in enumerate(zip(joints.lower, home, joints.upper, strict=True)):
        if not low <= q <= high:
            raise InputError(
                f"{part} joint {joint + 1} ranges from {low} to {high}: valid ranges hold home, {q:.4f}"
            )


@dataclass(frozen=True)
class _RobotFile:
    """A robot file: names of an arm's and a hand's file, and of a mount of the hand."""

    name: Word
    arm: Word
    hand: Word
    mount: Word


def read_content(path: Path, what: str) -> Fields:
    """Return what a YAML file of schema 1 says, nulls left out.

    Raises:
        InputError: if it is no such file.
    """
    content = read_yaml(path, what)
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise InputError(
            f"{what} {path} must be a mapping with schema: {SCHEMA}, as assets/robot/cell.yaml is"
        )
    return {key: value for key, value in content.items() if value is not None}


def read_robot(path: Path) -> Robot:
    """Read a robot and the files it names.

    Raises:
        InputError: one line: what is wrong, in which file, and what is valid.
    """
    with said_of(path):
        file = read(_RobotFile, _body(path), "robot")
        arm = _in(path.parent, file.arm, make_arm)
        hand = _in(path.parent, file.hand, make_hand)
        twice = set(arm.joints.names + arm.bodies) & set(hand.joints.names + hand.bodies)
        if twice:
            raise InputError(f"arm and hand share the names {', '.join(sorted(twice))}")
        return Robot(file.name, arm, hand, hand.mount(file.mount))


@contextmanager
def said_of(path: Path) -> Iterator[None]:
    """Name the file in the message of what is wrong within, unless it is named there."""
    try:
        yield
    except InputError as error:
        where = "" if str(path) in str(error) else f"{path}: "
        raise InputError(f"{where}{error}") from None


def find_beside(folder: Path, name: str) -> Path:
    """Return the file that another one in `folder` names: beside it, absolute, or one of ours."""
    path = folder / expand(name)
    if path.is_file():
        check_file(path)
        return path
    with suppress(FileNotFoundError):
        if (ours := asset_path("robot", name)).is_file():
            return ours
    raise InputError(f"{path} does not exist: name a file relative to {folder}")


def _body(path: Path) -> Fields:
    content = read_content(path, "robot file")
    return {key: value for key, value in content.items() if key not in ("schema", "kind", "licence")}


def _in(folder: Path, name: str, make: "Callable[[Fields], Any]") -> Any:
    """Return what is made of a file and its description in MJCF."""
    path = find_beside(folder, name)
    with said_of(path):
        entry = _body(path)
        mjcf = find_beside(path.parent, check("mjcf", entry.get("mjcf"), WORD)).resolve()
        return make(entry | {"mjcf": mjcf})


def _split(entry: Fields) -> tuple[Fields, Fields]:
    """Return the limits and gains of a part, and the rest."""
    limits = {key: entry[key] for key in SETTINGS if key in entry}
    return limits, {key: value for key, value in entry.items() if key not in limits}


def make_arm(entry: Fields) -> Arm:
    """Return an arm of what its file says.

    Raises:
        InputError: one line: what is wrong, and what is valid.
    """
    limits, rest = _split(entry)
    joints = read_joints("arm", limits, check("joints", entry.get("joints"), NAMES))
    arm = read(Arm, rest | {"joints": joints}, "arm")
    check_home("arm", joints, arm.home)
    if max(arm.shaken) >= len(arm.home):
        raise InputError(f"shaken is {arm.shaken}: valid are two numbers of joints, from 0 on")
    if len(arm.bodies) != len(joints.names) + 1:
        raise InputError(
            f"bodies are {len(arm.bodies)}: valid are a base and one for each of {len(joints.names)} joints"
        )
    for start in arm.starts:
        check_length("a posture of starts", start, len(arm.home))
    return arm


def make_hand(entry: Fields) -> Hand:
    """Return a hand of what its file says.

    Raises:
        InputError: one line: what is wrong, and what is valid.
    """
    limits, rest = _split(entry)
    fingers = check("fingers", entry.get("fingers"), FINGERS)
    joints = read_joints("hand", limits, tuple(name for finger in fingers for name in finger.joints))
    hand = read(Hand, rest | {"joints": joints, "fingers": fingers}, "hand")
    check_home("hand", joints, hand.open)
    _check_names(hand)
    if hand.frame is not None and any(finger.frame is None for finger in hand.fingers):
        raise InputError("a finger has no frame: valid is one of each tip, where the palm has one")
    return hand


def _check_names(hand: Hand) -> None:
    names = [finger.name for finger in hand.fingers]
    for finger in hand.fingers:
        if finger.aside:
            check_length(f"aside of {finger.name}", finger.aside, len(finger.joints))
    for grasp in (hand.grasp, *hand.grasps):
        if missing := set(grasp) - set(names):
            raise unknown_name("finger of a grasp", min(missing), names)
        if not 2 + (not hand.torsion) <= len(grasp) <= 5:
            raise InputError(
                f"a grasp of {len(grasp)} fingers: valid are 3 to 5, or 2 to 5 of a hand with a torsion"
            )
    followers = [own.joint for own in hand.couplings]
    leaders = [own.follows for own in hand.couplings]
    for name in followers + leaders:
        if name not in hand.joints.names:
            raise unknown_name("joint of a coupling", name, hand.joints.names)
    if len(set(followers)) < len(followers) or {*followers} & {*leaders}:
        raise InputError("couplings: valid is one of each joint, to a joint that follows none itself")
    for tendon in hand.tendons:
        check_length("coefs of a tendon", tendon.coefs, len(tendon.joints))
        if (
            not any(set(tendon.joints) <= set(finger.joints) for finger in hand.fingers)
            or tendon.coefs[-1] != 1.0
        ):
            raise InputError(
                f"tendon of {', '.join(tendon.joints)}: valid are joints of one finger, the last of coef 1"
            )
    linked = {hand.beside_palm, *(name for pair in hand.self_pairs + hand.excluded for name in pair)}
    if unknown := sorted(linked - {"", *hand.bodies}):
        raise InputError(
            f"self_pairs, excluded and beside_palm name {', '.join(unknown)}: no body of the hand"
        )
