"""What an agent hands over to be carried out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError

Array = NDArray[np.float64]


class NoPath(Exception):  # noqa: N818  (it is an outcome, not a defect)
    """A grasp that cannot be carried out.

    Attributes:
        reason: in a word that can be counted, e.g. `approach_blocked`.
        detail: which bodies are in the way and by how much.
    """

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason, self.detail = reason, detail


@dataclass(frozen=True)
class GraspMotion:
    """A grasp as set-points of the joint servos, (23,) rad each, robot order.

    Attributes:
        pregrasp: fingers open around the object, touching nothing.
        grasp: fingertips in contact.
        squeeze: inside the object, so that the servos press: grasp + J^T f / kp, hand kp 10 Nm/rad.
        lift_height: how far to lift, m.
    """

    pregrasp: Array
    grasp: Array
    squeeze: Array
    lift_height: float = 0.14

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        for name in ("pregrasp", "grasp", "squeeze"):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (23,) or not np.isfinite(value).all():
                raise InputError(f"{name} of a grasp motion must be 23 finite joint positions in radians")
            object.__setattr__(self, name, value)
        if not 0.0 < self.lift_height <= 0.5:
            raise InputError(f"lift_height is {self.lift_height}: valid is above 0 and up to 0.5 m")
