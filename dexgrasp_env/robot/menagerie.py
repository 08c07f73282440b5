"""What the robot looks like: our own shapes. The name `menagerie` is kept for the meshes of MuJoCo Menagerie.

The package `mujoco-menagerie` brings no meshes: it downloads them at their first use. No version here shows them
yet; asking for them says so. Nothing depends on the package.
"""

from importlib.util import find_spec

from dexgrasp_env.errors import InputError, unknown_name

VISUALS: tuple[str, ...] = ("primitives", "menagerie")
"""The known looks; `primitives` can be shown."""

_UNSHOWN = "this version does not show its meshes yet, use visuals 'primitives'"


def check_visuals(visuals: str) -> None:
    """Check that the robot can be shown so.

    Args:
        visuals: a member of `VISUALS`.

    Raises:
        InputError: if the name is not known, or is `menagerie`.
    """
    if visuals not in VISUALS:
        raise unknown_name("visuals", visuals, VISUALS)
    if visuals == "menagerie":
        if find_spec("mujoco_menagerie") is None:
            missing = "needs the package mujoco-menagerie (pip install mujoco-menagerie)"
            raise InputError(f"visuals 'menagerie' {missing}, and {_UNSHOWN}")
        raise InputError(f"visuals 'menagerie': mujoco-menagerie is installed, but {_UNSHOWN}")
