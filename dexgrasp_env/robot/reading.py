"""What the readers of robot and cell files check: mappings, names and numbers, each fault said in one line."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.robot import Joints, Mount, Names, Numbers

LIMITS = ("lower", "upper", "velocity", "acceleration", "jerk", "torque")
GAINS = ("stiffness", "damping")
_FARTHEST = 0.5  # m from the arm's last link to the palm frame


def mapping(what: str, value: Any, known: Iterable[str] | None = None) -> dict[str, Any]:
    """Return a mapping of settings; with `known`, of these alone."""
    if not isinstance(value, dict):
        raise InputError(f"{what} is {str(value)[:60]}: valid is a mapping of settings")
    for key in value if known is not None else ():
        if key not in (valid := tuple(known or ())):
            raise InputError(f"unknown setting of {what} {key!r}: valid are {', '.join(valid)}")
    return value


def word(what: str, value: Any) -> str:
    """Return a name."""
    if not isinstance(value, str) or not value:
        raise InputError(f"{what} is {value!r}: valid is a word")
    return value


def words(what: str, value: Any) -> Names:
    """Return a list of names that differ."""
    if not isinstance(value, list) or not value or len({word(what, name) for name in value}) < len(value):
        raise InputError(f"{what} is {str(value)[:60]}: valid is a list of names, each once")
    return tuple(value)


def number(what: str, value: Any) -> float:
    """Return a finite number."""
    return numbers(what, [value], 1)[0]


def numbers(what: str, value: Any, size: int, *, repeat: bool = False) -> Numbers:
    """Return `size` finite numbers; with `repeat` one stands for all."""
    rows = [value] * size if repeat and not isinstance(value, list) else value
    if not isinstance(rows, list) or len(rows) != size or not all(map(_is_number, rows)):
        raise InputError(f"{what} is {str(value)[:60]}: valid are {size} finite numbers")
    return tuple(float(x) for x in rows)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def read_joints(part: str, entry: Mapping[str, Any], names: Names) -> Joints:
    """Return the limits and gains that a mapping states for joints."""
    given = {
        name: numbers(f"{part} {name}", entry[name], len(names), repeat=True)
        for name in (*LIMITS, *GAINS)
        if name in entry or name != "damping"
    }
    for name, values in given.items():
        if name not in ("lower", "upper") and min(values) <= 0.0:
            raise InputError(f"{part} {name} has {min(values)}: valid are numbers above 0")
    if part == "hand" and len(set(given["stiffness"])) > 1:
        raise InputError("hand stiffness differs between joints: valid is one number")
    return Joints(names, **given)


def read_mount(name: str, value: Any) -> Mount:
    """Return a mount."""
    entry = mapping(f"mount {name}", value, ("position", "quat_wxyz"))
    position = numbers(f"position of mount {name}", entry.get("position"), 3)
    quat = numbers(f"quat_wxyz of mount {name}", entry.get("quat_wxyz"), 4)
    if abs(float(np.linalg.norm(quat)) - 1.0) > 1e-6:
        raise InputError(f"quat_wxyz of mount {name} has norm {np.linalg.norm(quat):.6f}: valid is 1")
    if float(np.linalg.norm(position)) > _FARTHEST:
        raise InputError(
            f"position of mount {name} is {position}: valid is within {_FARTHEST} m of the last link"
        )
    return Mount(name, position, quat)


def check_narrower(part: str, own: Joints, maker: Joints, home: Numbers) -> None:
    """Refuse limits that are wider than the robot's own, and ranges that do not hold home."""
    for name in LIMITS:
        sign, most = (-1.0, "least") if name == "lower" else (1.0, "most")
        for joint, (value, bound) in enumerate(zip(getattr(own, name), getattr(maker, name), strict=True)):
            if sign * value > sign * bound:
                raise InputError(
                    f"{part} {name} of joint {joint + 1} is {value}: valid is at {most} {bound}, the maker's"
                )
    for joint, (low, q, high) in enumerate(zip(own.lower, home, own.upper, strict=True)):
        if not low <= q <= high:
            raise InputError(
                f"{part} joint {joint + 1} ranges from {low} to {high}: valid ranges hold home, {q:.4f}"
            )
