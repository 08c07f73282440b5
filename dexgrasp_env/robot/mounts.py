"""How the hand sits on the arm's flange."""

from dataclasses import dataclass

from dexgrasp_env.errors import unknown_name
from dexgrasp_env.robot.cell import active_cell


@dataclass(frozen=True)
class Mount:
    """The palm frame in the frame of the arm's link 7.

    Attributes:
        position: (3,) of the palm frame, m.
        quat_wxyz: (4,) of the palm frame.
    """

    position: tuple[float, ...]
    quat_wxyz: tuple[float, ...]


MOUNTS: dict[str, Mount] = {name: Mount(position, quat) for name, position, quat in active_cell().mounts}
"""The known mounts, as the cell has them. `palm_normal` reaches more of a table from above."""


def find_mount(name: str) -> Mount:
    """Return the mount of that name.

    Raises:
        InputError: if there is none.
    """
    if name not in MOUNTS:
        raise unknown_name("mount", name, MOUNTS)
    return MOUNTS[name]
