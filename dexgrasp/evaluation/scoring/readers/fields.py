"""Named fields of files of other programs, checked when they are read."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import pose_matrix


class FileFields:
    """Fields of a file, or of a grasp in it.

    Every method raises InputError, naming the source, for a field that is missing or of another type.
    """

    def __init__(self, content: Any, source: str) -> None:
        """Wrap a dictionary; `source` names it in messages."""
        if not isinstance(content, Mapping):
            raise InputError(
                f"{source} is malformed: fields by name are needed, not {type(content).__name__}"
            )
        self._content, self.source = content, source

    def __contains__(self, name: str) -> bool:
        return self._content.get(name) is not None

    def get(self, name: str) -> Any:
        """Return a field as it is."""
        if name not in self:
            has = ", ".join(sorted(map(str, self._content))) or "nothing"
            raise InputError(f"{self.source}: {name} is missing (it has {has}; docs/scoring.md)")
        return self._content[name]

    def words(self, name: str) -> list[str]:
        """Return a list of texts."""
        return [str(word) for word in np.ravel(self.get(name))]

    def numbers(self, name: str) -> Array:
        """Return finite numbers of any shape, one at least."""
        given = self.get(name)
        try:
            value = np.asarray(given, dtype=float)
        except (TypeError, ValueError):
            value = np.full(1, np.nan)
        if value.size == 0 or not np.isfinite(value).all():
            raise InputError(f"{self.source}: {name} must be finite numbers")
        return value

    def vectors(self, name: str) -> Array:
        """Return (k, 3) numbers, two rows at least."""
        value = self.numbers(name)
        if value.shape[1:] != (3,) or len(value) < 2:
            raise InputError(f"{self.source}: {name} must be (k, 3) finite numbers, k at least 2")
        return value

    def pose(self, name: str) -> Array:
        """Return a pose (4, 4) from a matrix, or from 7 numbers (position, quaternion wxyz)."""
        return as_pose(self.numbers(name), f"{self.source}: {name}")


def as_pose(T: Array, name: str) -> Array:
    """Return a pose (4, 4) from a matrix, or from 7 numbers (position, quaternion wxyz).

    Raises:
        InputError: if it is neither, or no rigid transform.
    """
    if T.shape == (7,) and (length := np.linalg.norm(T[3:])) > 1e-6:
        return pose_matrix(T[:3], T[3:] / length)
    if T.shape != (4, 4):
        raise InputError(f"{name} must be a (4, 4) pose, or 7 numbers: position m, quaternion wxyz")
    R, last = T[:3, :3], T[3] - [0, 0, 0, 1]
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0 or np.abs(last).max() > 1e-6:
        raise InputError(f"{name} is no rigid transform (rotation, position, last row 0 0 0 1)")
    return T
