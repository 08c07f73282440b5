"""Limits and gains of joints as files state them: of a robot's maker, or of a cell, which may narrow them."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.robot.robot import Joints, Numbers
from dexgrasp_env.valid import Names, read

SETTINGS = tuple(field.name for field in fields(Joints) if field.name != "names")
_GAINS = ("stiffness", "damping")


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
    for key in own.keys() - set(_GAINS):
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
