"""Disturbances: pushes of the held object in six directions, shaking of the arm, motion of the object beforehand.

Pushes and shaking begin once the object has been held for 1 s, while the agent acts on; motion is in `moving`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from dexgrasp_env.errors import InputError
from dexgrasp_env.tasks.constants import at_pace
from dexgrasp_env.valid import number, one_of, read

KINDS = ("none", "pushed", "shaken", "moved", "belt")
PUSH_STEPS = 10  # control steps of one push, 0.5 s
PAUSE_STEPS = 4  # control steps between pushes, 0.2 s


@dataclass(frozen=True)
class Disturbance:
    """Disturbance of an object: its kind and size.

    Attributes:
        kind: `none`; `pushed`: along +x, -x, +y, -y, +z, -z of the world, 0.5 s each and 0.2 s apart; `shaken`: 2 s of
            sines on the set-points of panda_joint1 (0.06 rad, 3 Hz) and panda_joint4 (0.04 rad, 2.4 Hz); `moved`:
            displaced within 0.5 s, 0.2 to 1.5 s after the start, by up to `size` and turned by up to 60 deg, unless the
            hand touches it; `belt`: carried along y all the time.
        size: of a push, in multiples of the object's true weight; of the shaking, a factor on its amplitudes; cm of a
            displacement; cm/s of a belt.
    """

    kind: Annotated[str, one_of(KINDS)] = "none"
    size: Annotated[float, number(ge=0, le=10)] = 1.0

    def __post_init__(self) -> None:
        if self.kind == "none" and self.size != 1.0:
            raise InputError(f"disturbance none has size {self.size:g}, which changes nothing: leave it out")

    @property
    def moves(self) -> bool:
        """True where the object moves before it is grasped."""
        return self.kind in ("moved", "belt")

    def steps_at(self, frame_skip: int) -> int:
        """Return how long it lasts, control steps of so many physics steps."""
        push, pause = at_pace(PUSH_STEPS, frame_skip), at_pace(PAUSE_STEPS, frame_skip)
        shaken = at_pace(40, frame_skip)  # control steps, 2 s
        return {"pushed": 6 * push + 5 * pause, "shaken": shaken}.get(self.kind, 0)

    @classmethod
    def of(cls, value: "Disturbance | Mapping[str, Any] | str") -> "Disturbance":
        """Return a disturbance from its name or a mapping of its attributes.

        Raises:
            InputError: for an unknown kind or key, a size that is not a number of 0 to 10, or one of `none`.
        """
        return read(cls, {"kind": value} if isinstance(value, str) else value, "disturbance")
