"""Disturbances of a held object: pushes in six directions, or shaking of the arm.

They begin once the object has been held for 1 s, while the agent acts on.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.tasks.constants import MAX_EPISODE_STEPS

KINDS = ("none", "pushed", "shaken")
PUSH_STEPS = 10  # control steps of one push, 0.5 s
PAUSE_STEPS = 4  # control steps between pushes, 0.2 s
STEPS = {"none": 0, "pushed": 6 * PUSH_STEPS + 5 * PAUSE_STEPS, "shaken": 40}
"""Length of each kind, control steps."""


@dataclass(frozen=True)
class Disturbance:
    """What happens to the held object.

    Attributes:
        kind: `none`; `pushed`: along +x, -x, +y, -y, +z, -z of the world, 0.5 s each and 0.2 s apart; `shaken`: 2 s of
            sines on the set-points of panda_joint1 (0.06 rad, 3 Hz) and panda_joint4 (0.04 rad, 2.4 Hz).
        size: of a push, in multiples of the object's true weight; of the shaking, a factor on its amplitudes.
    """

    kind: str = "none"
    size: float = 1.0

    @property
    def steps(self) -> int:
        """How long it lasts, control steps."""
        return STEPS[self.kind]

    def warn_of_limit(self, limit: int | None) -> None:
        """Warn where the usual time limit, which a wrapper keeps, leaves no time for the disturbance.

        Args:
            limit: of an episode, control steps.
        """
        if self.steps and limit == MAX_EPISODE_STEPS:
            longer = f"max_episode_steps={MAX_EPISODE_STEPS + self.steps}"
            warnings.warn(
                f"{self.kind!r} takes {self.steps} steps of the {limit}: pass {longer}", stacklevel=3
            )

    @classmethod
    def of(cls, value: "Disturbance | Mapping[str, Any] | str | None") -> "Disturbance":
        """Return a disturbance from its name or a mapping of its attributes.

        Raises:
            InputError: for an unknown kind or key, or a size that is not a number of 0 to 10.
        """
        if value is None or isinstance(value, Disturbance):
            return value or cls()
        settings = {"kind": value} if isinstance(value, str) else dict(value)
        for key in settings:
            if key not in ("kind", "size"):
                raise unknown_name("disturbance key", key, ("kind", "size"))
        kind, size = settings.get("kind", "none"), settings.get("size", 1.0)
        if kind not in KINDS:
            raise unknown_name("disturbance", kind, KINDS)
        if not (isinstance(size, int | float) and np.isfinite(size) and 0.0 <= size <= 10.0):
            raise InputError(f"disturbance size = {size!r}: valid is a number from 0 to 10")
        return cls(kind, float(size))
