"""Set files and their meshes, as `outside.py`, `kitchen.py`, `folder_set.py` and `fetch_ycb.py` write them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from dexgrasp_env.files import write_json
from dexgrasp_env.objects.sets import SCHEMA, read_set


def write_set(path: Path, members: Sequence[dict[str, Any]]) -> None:
    """Write a set file, whose meshes are there, and say so.

    Raises:
        InputError: if it cannot be read again.
    """
    write_json(path, {"schema": SCHEMA, "objects": members})
    print(f"wrote {path}: {len(read_set(str(path)))} objects")


def obj_of(corners: NDArray[Any], faces: NDArray[Any]) -> bytes:
    """Return a mesh as an obj file; corners to a hundredth of a millimetre, so that rounding changes no bit."""
    lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in corners]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    return "\n".join([*lines, ""]).encode()
