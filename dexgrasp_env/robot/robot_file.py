"""Reader of robot files: an arm's, a hand's, and the robot's that names both; paths in a file are relative to it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand, read_yaml
from dexgrasp_env.robot.reading import (
    GAINS,
    LIMITS,
    check_narrower,
    mapping,
    number,
    numbers,
    read_joints,
    read_mount,
    word,
    words,
)  # fmt: skip
from dexgrasp_env.robot.robot import Adapter, Arm, Finger, Hand, Robot

SCHEMA = 1
_HEAD = ("schema", "kind", "name", "licence", "mjcf")
_ARM = (*_HEAD, "joints", "bodies", *LIMITS, *GAINS, "home", "shoulder", "reach", "shaken", "adapter")
_HAND = (
    *_HEAD, "palm", *LIMITS, *GAINS, "open", "fingers", "grasp", "mounts", "beside_palm", "self_pairs",
)  # fmt: skip
_ROBOT = ("schema", "kind", "name", "arm", "hand", "mount")


def read_content(path: Path, what: str) -> dict[str, Any]:
    """Return a YAML file of schema 1.

    Raises:
        InputError: if it is no such file.
    """
    content = read_yaml(path, what)
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise InputError(
            f"{what} {path} must be a mapping with schema: {SCHEMA}, as assets/robot/cell.yaml is"
        )
    return content


def read_robot(path: Path) -> Robot:
    """Read a robot and the files it names.

    Raises:
        InputError: one line: what is wrong, in which file, and what is valid.
    """
    entry = mapping("a robot", read_content(path, "robot file"), _ROBOT)
    _complete(path, entry, _ROBOT)
    arm = _in(path.parent, entry["arm"], _arm)
    hand = _in(path.parent, entry["hand"], _hand)
    twice = set(arm.joints.names + arm.bodies) & set(hand.joints.names + hand.bodies)
    if twice:
        raise InputError(f"robot file {path}: arm and hand share the names {', '.join(sorted(twice))}")
    return Robot(word("name", entry["name"]), arm, hand, hand.mount(word("mount", entry["mount"])))


def find_beside(folder: Path, name: Any) -> Path:
    """Return the file that another one in `folder` names: beside it, absolute, or one of ours."""
    path = folder / expand(word("file", name))
    if path.is_file():
        return path
    try:
        return asset_path("robot", str(name))
    except FileNotFoundError:
        raise InputError(f"{path} does not exist: name a file relative to {folder}") from None


def _in(folder: Path, name: Any, make: "Callable[[Path, dict[str, Any]], Any]") -> Any:
    path = find_beside(folder, name)
    try:
        return make(path, read_content(path, "robot file"))
    except InputError as error:
        where = "" if str(path) in str(error) else f"{path}: "
        raise InputError(f"{where}{error}") from None


def _complete(path: Path, entry: dict[str, Any], keys: tuple[str, ...]) -> None:
    missing = [key for key in keys if key not in entry]
    if missing:
        raise InputError(f"{path} lacks {', '.join(missing)}")


def _arm(path: Path, content: dict[str, Any]) -> Arm:
    entry = mapping("an arm", content, _ARM)
    _complete(path, entry, tuple(key for key in _ARM if key not in ("licence", "adapter", "damping")))
    joints = read_joints("arm", entry, words("joints", entry["joints"]))
    home = numbers("home", entry["home"], len(joints.names))
    check_narrower("arm", joints, joints, home)
    shaken = [int(number("shaken", joint)) for joint in entry["shaken"]]
    if len(shaken) != 2 or not all(0 <= joint < len(home) for joint in shaken):
        raise InputError(f"shaken is {entry['shaken']}: valid are two numbers of joints, from 0 on")
    return Arm(
        name=word("name", entry["name"]),
        mjcf=find_beside(path.parent, entry["mjcf"]).resolve(),
        joints=joints,
        bodies=words("bodies", entry["bodies"]),
        home=home,
        shoulder=numbers("shoulder", entry["shoulder"], 3),
        reach=number("reach", entry["reach"]),
        shaken=(shaken[0], shaken[1]),
        adapter=_adapter(entry.get("adapter")),
    )


def _adapter(value: Any) -> Adapter | None:
    if value is None:
        return None
    entry = mapping("adapter", value, ("from", "to", "radius", "look", "material"))
    start, end, radius = (number(f"adapter {key}", entry.get(key)) for key in ("from", "to", "radius"))
    look, material = (word(f"adapter {key}", entry.get(key)) for key in ("look", "material"))
    return Adapter(start, end, radius, look, material)


def _hand(path: Path, content: dict[str, Any]) -> Hand:
    entry = mapping("a hand", content, _HAND)
    optional = ("licence", "damping", "beside_palm", "self_pairs")
    _complete(path, entry, tuple(key for key in _HAND if key not in optional))
    if not isinstance(entry["fingers"], list) or len(entry["fingers"]) < 2:
        raise InputError("fingers must be a list of two fingers or more")
    fingers = tuple(map(_finger, entry["fingers"]))
    joints = read_joints("hand", entry, tuple(name for finger in fingers for name in finger.joints))
    hand = Hand(
        name=word("name", entry["name"]),
        mjcf=find_beside(path.parent, entry["mjcf"]).resolve(),
        palm=word("palm", entry["palm"]),
        joints=joints,
        fingers=fingers,
        grasp=words("grasp", entry["grasp"]),
        open=numbers("open", entry["open"], len(joints.names)),
        mounts=tuple(read_mount(name, value) for name, value in mapping("mounts", entry["mounts"]).items()),
        beside_palm=entry.get("beside_palm") or "",
        self_pairs=tuple((words("self_pairs", pair)[0], pair[1]) for pair in entry.get("self_pairs") or []),
    )
    check_narrower("hand", joints, joints, hand.open)
    _check_names(hand)
    return hand


def _finger(value: Any) -> Finger:
    entry = mapping("a finger", value, ("name", "joints", "bodies", "tip", "pad", "aside"))
    name = word("name of a finger", entry.get("name"))
    joints, bodies = (words(f"{key} of {name}", entry.get(key)) for key in ("joints", "bodies"))
    pad = numbers(f"pad of {name}", entry.get("pad"), 3)
    aside = entry.get("aside", ())
    aside = numbers(f"aside of {name}", aside, len(joints)) if aside else ()
    return Finger(name, joints, bodies, word(f"tip of {name}", entry.get("tip")), pad, aside)


def _check_names(hand: Hand) -> None:
    names = [finger.name for finger in hand.fingers]
    for name in hand.grasp:
        if name not in names:
            raise InputError(f"grasp names {name!r}: valid are {', '.join(names)}")
    linked = {name for pair in hand.self_pairs for name in pair} | ({hand.beside_palm} - {""})
    if unknown := sorted(linked - set(hand.bodies)):
        raise InputError(f"self_pairs and beside_palm name {', '.join(unknown)}: no body of the hand")
