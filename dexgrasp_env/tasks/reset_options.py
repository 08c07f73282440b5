"""Options of a reset, checked."""

import warnings
from collections.abc import Collection, Mapping
from difflib import get_close_matches
from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array, Fields, array
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.valid import check

_BEYOND = 1e-3  # rad that single precision may add


def check_options(
    options: Mapping[str, Any] | None, known: Collection[str], objects: Collection[str]
) -> Fields:
    """Return the options of a reset that are ours.

    Args:
        options: as they are given.
        known: names of those that the task has.
        objects: of the environment.

    Raises:
        InputError: for an unknown option or object, or two that contradict each other.
    """
    options = {key: value for key, value in (options or {}).items() if not _is_foreign(key, known)}
    for key in options:
        if key not in known:
            raise unknown_name("reset option", key, known)
    if "joints" in options and "object_pose" not in options:
        raise InputError(
            "reset option joints is for where the hand is about an object: give object_pose beside it"
        )
    if "object" in options and options["object"] not in objects:
        raise unknown_name("object", options["object"], objects)
    if "state" in options and (beside := sorted({"object", "object_pose", "joints"} & options.keys())):
        raise InputError(
            f"reset options {', '.join(beside)} beside state: valid is either, as it has its own"
        )
    return options


def check_joints(given: Any, robot: Robot) -> Array | None:
    """Return the joints (n,) rad that a robot is to begin at, None where none are given.

    Raises:
        InputError: if these are not so many numbers, or beyond the joints' ranges.
    """
    if given is None:
        return None
    joints: Array = check("joints", given, array(robot.dof))
    beyond = (joints < robot.lower - _BEYOND) | (joints > robot.upper + _BEYOND)
    if beyond.any():
        names = ", ".join(name for name, off in zip(robot.joints, beyond, strict=True) if off)
        raise InputError(f"joints are beyond the ranges of {names}: valid is within, rad")
    return np.clip(joints, robot.lower, robot.upper)


def _is_foreign(key: str, known: Collection[str]) -> bool:
    """Return whether a reset option is of another program's name space, as `lerobot_new_rollout` is; warn of it.

    What begins with a word of ours is a mistake in one of ours.
    """
    space, underscore, _ = str(key).partition("_")
    foreign = bool(underscore) and not get_close_matches(
        space, {"reset", *" ".join(known).replace("_", " ").split()}
    )
    if foreign:
        warnings.warn(f"reset option {key!r} is of another program: it is passed over", stacklevel=6)
    return foreign
