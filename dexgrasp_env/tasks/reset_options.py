"""Options of a reset, checked."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array, Fields, array
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.valid import check, instance


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
    # LeRobot's rollouts give options of their own.
    given = check("options", options or {}, instance(Mapping, "a mapping"))
    options = {key: value for key, value in given.items() if not str(key).startswith("lerobot_")}
    for key in options:
        if key not in known:
            raise unknown_name("reset option", key, known)
    if "joints" in options and "object_pose" not in options:
        raise InputError(
            "reset option joints is for where the hand is about an object: give object_pose beside it"
        )
    if "object" in options and str(options["object"]) not in objects:
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
    rounding = 1e-3  # rad that single precision may add
    beyond = (joints < robot.lower - rounding) | (joints > robot.upper + rounding)
    if beyond.any():
        names = ", ".join(name for name, off in zip(robot.joints, beyond, strict=True) if off)
        raise InputError(f"joints are beyond the ranges of {names}: valid is within, rad")
    return np.clip(joints, robot.lower, robot.upper)
