"""Reverse curriculum: episodes begin near success, then farther and farther back (Florensa et al., 2017)."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Fields, array
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError, first_line
from dexgrasp_env.files import expand, read_npz
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.slots import Starts
from dexgrasp_env.valid import check, number

_LATEST, _BACK = 0.9, 0.1  # shares of a way: where episodes begin at first, what is won at a time
_WON, _OF = 0.6, 50  # share of the last so many episodes from the front that succeed before it moves back
SHIPPED = "pregrasps"
"""What stands for the pre-grasps that are shipped."""


class ReverseStarts(ABC):
    """Reverse curriculum: episodes begin on ways to success from `front` on, and some as usual.

    Attributes:
        front: share of a way, from which on episodes begin; moves from near success to 0, its beginning, as episodes
            from about there succeed.
        whole: share of the episodes that begin as usual; it may be changed at any time.
    """

    def __init__(self, whole: float = 0.2, front: float = _LATEST) -> None:
        share = number(ge=0, le=1)
        self.whole, self.front = check("whole", whole, share), check("front", front, share)
        self._recent: deque[bool] = deque(maxlen=_OF)
        self._won = "solved", 1  # what a record says of an episode that succeeded, at least
        self._near: dict[int, bool] = {}

    @property
    @abstractmethod
    def ways(self) -> int:
        """Number of ways to begin on."""

    @abstractmethod
    def options(self, way: int, share: float) -> Fields:
        """Return the options of a reset on a way, at a share of it."""

    @property
    def progress(self) -> Fields:
        """State of the starts, for `go_on`."""
        return {"front": self.front, "recent": list(self._recent)}

    def go_on(self, front: float, recent: Sequence[bool]) -> None:
        """Take up `progress`; episodes that run count no more."""
        self.front, self._recent, self._near = front, deque(recent, maxlen=_OF), {}

    def __call__(self, slot: int, rng: Generator, record: Mapping[str, Any]) -> Fields:
        """Note how the last episode of a slot went, and return the options of its next reset."""
        if self._near.pop(slot, False):
            name, least = self._won
            self._recent.append(bool(record[name] >= least))
        if len(self._recent) == _OF and sum(self._recent) >= _WON * _OF:
            self.front = max(self.front - _BACK, 0.0)
            self._recent.clear()
        if rng.random() < self.whole:
            return {}
        way = int(rng.integers(self.ways))
        # Half of them at the front: what moves it is soon known, and what was learned behind it is not forgotten.
        share = self.front + rng.uniform(0.0, _BACK if rng.random() < 0.5 else 1.0 - self.front)
        self._near[slot] = share < self.front + _BACK
        return self.options(way, share)


class PreGrasps(ReverseStarts):
    """Beginnings on ways to certified pre-grasps: the arm on its way, the object as it lay when it was planned for.

    Attributes:
        names: (K,) of the objects.
        poses: (K, 7) of the objects, m and quaternion wxyz.
        ways_joints: (K, T, n) rad, from home to the fingers open around the object.
    """

    def __init__(
        self, file: str | Path | None = None, objects: Sequence[str] | None = None, **more: Any
    ) -> None:
        """Read pre-grasps.

        Args:
            file: of `scripts/pregrasps.py`; None for those that are shipped.
            objects: that pre-grasps are wanted of; None for all there are.
            more: of `ReverseStarts`.

        Raises:
            InputError: if there is no such file, it holds none, or none of these objects.
        """
        super().__init__(**more)
        path = asset_path("pregrasps.npz") if file is None else expand(file)
        try:
            kept = read_npz(path)
            names = kept["objects"]
            poses = array(len(names), 7).validate(kept["poses"])
            ways = array(len(names), None, None).validate(kept["ways"])
        except FileNotFoundError:
            raise InputError(f"{path} does not exist: valid is a file of scripts/pregrasps.py") from None
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path} holds no pre-grasps ({first_line(error)})") from None
        wanted = np.isin(names, list(objects)) if objects is not None else np.ones(len(names), bool)
        if not wanted.any():
            known = ", ".join(sorted(set(names.tolist())))
            raise InputError(f"{path} has pre-grasps of none of these objects: valid are {known}")
        self.names, self.poses, self.ways_joints = names[wanted].tolist(), poses[wanted], ways[wanted]

    @property
    def ways(self) -> int:
        """Number of pre-grasps."""
        return len(self.names)

    def options(self, way: int, share: float) -> Fields:
        """Return object, pose and joints of a reset with the arm at a share of the way."""
        joints = self.ways_joints[way]
        at = min(share, 1.0) * (len(joints) - 1)
        k = min(int(at), len(joints) - 2)
        posture = joints[k] + (at - k) * (joints[k + 1] - joints[k])
        return {"object": self.names[way], "object_pose": self.poses[way], "joints": posture}


def valid_starts(starts: Starts | None) -> Starts | None:
    """Return what gives resets their options, as it is.

    Raises:
        InputError: for what cannot be asked for them.
    """
    if starts is not None and (isinstance(starts, type) or not callable(starts)):
        raise InputError(f"starts is {starts!r}: valid is what returns a reset's options, as PreGrasps()")
    return starts


def pre_grasps(settings: LiftSettings) -> PreGrasps | None:
    """Return the pre-grasps that an environment begins at, None where its settings name none.

    Raises:
        InputError: as `PreGrasps`, and for a hand that is another, or mounted otherwise, than they were planned for.
    """
    if settings.starts is None:
        return None
    planned, here = default_cell().robot, settings.cell.robot
    if (here.joints, here.mount.name) != (planned.joints, planned.mount.name):
        raise InputError(
            f"starts are of the robot {planned.name} with mount {planned.mount.name}: valid is that one, or starts=None"
        )
    return PreGrasps(None if settings.starts == SHIPPED else settings.starts, settings.objects)
