"""Options of a reset, checked."""

import warnings
from collections.abc import Collection, Mapping
from difflib import get_close_matches
from typing import Any

from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError, unknown_name


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
    if "object" in options and options["object"] not in objects:
        raise unknown_name("object", options["object"], objects)
    if "state" in options and (beside := sorted({"object", "object_pose"} & options.keys())):
        raise InputError(
            f"reset options {', '.join(beside)} beside state: valid is either, as it has its own"
        )
    return options


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
