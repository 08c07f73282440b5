"""Optional parts of the installation: which extra brings what, and one line that says so where it is missing."""

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from dexgrasp_env.errors import InputError

EXTRAS: dict[str, tuple[str, ...]] = {
    "planner": (
        "clarabel", "daqp", "imageio", "imageio_ffmpeg", "jinja2", "loky", "matplotlib", "ompl", "osqp", "PIL",
        "qpsolvers", "rtree", "ruckig", "safetensors",
    ),
    "learning": ("torch", "stable_baselines3", "tensorboard"),
    "viewer": ("viser",),
    "serve": ("msgpack", "websockets"),
    "cluster": ("ray",),
    "dm": ("dm_control", "dm_env"),
    "demos": ("h5py", "minari", "pyarrow"),
    "formats": ("collada", "laspy", "lazrs", "lxml", "rosbags"),
    "lerobot": ("lerobot",),
    "engines": ("pybullet", "pydrake"),
    "season": ("py_ecc",),
    "gpu": ("mujoco_warp", "warp"),
}  # fmt: skip
"""Extra -> the modules that it brings and the plain installation lacks."""
NO_WHEEL: dict[str, tuple[tuple[int, int], str]] = {
    "dm": ((3, 13), "labmaze, which dm_control wants,"),
    "engines": ((3, 12), "pybullet"),
}
"""Extra -> the first Python on which it leaves out what has no wheel there, and what that is."""


class MissingExtraError(InputError, ImportError):
    """A part is used whose extra is not installed; the message says which one to install."""


def require_extra(extra: str, what: str) -> None:
    """Raise `MissingExtraError` unless the extra is installed; imports nothing.

    Args:
        extra: a key of `EXTRAS`.
        what: that needs it, the first words of the message.
    """
    for module in EXTRAS[extra]:
        if importlib.util.find_spec(module) is None:
            raise MissingExtraError(f"{what} needs {module}: {remedy(extra)}")


@contextmanager
def from_extra() -> Iterator[None]:
    """Imports of third parties go within: what is missing is reported with the extra that brings it."""
    try:
        yield
    except ImportError as error:
        raise (missing_extra(error) or error) from None


def missing_extra(error: ImportError) -> MissingExtraError | None:
    """Return the error that names the extra, where what is missing belongs to one."""
    root = (error.name or "").partition(".")[0]
    for extra, modules in EXTRAS.items():
        if root in modules:
            return MissingExtraError(f"{root} is not installed: {remedy(extra)}")
    return None


def remedy(extra: str) -> str:
    """Return how to install an extra, or why this Python has not all of it."""
    first, what = NO_WHEEL.get(extra, ((4, 0), ""))
    install = f"pip install 'dexgrasp[{extra}]'"
    if sys.version_info < first:
        return install
    return f"{what} has no wheel for Python {sys.version_info[0]}.{sys.version_info[1]}: {install} under an older one"
