"""How the hand sits on the arm's flange."""

from dataclasses import dataclass

from dexgrasp_env.errors import unknown_name

_HALF = 0.5**0.5
_COS_EIGHTH, _SIN_EIGHTH = 0.9238795325112867, 0.3826834323650898


@dataclass(frozen=True)
class Mount:
    """The palm frame in the frame of the arm's link 7.

    Attributes:
        position: of the palm frame, m.
        quat_wxyz: of the palm frame.
    """

    position: tuple[float, float, float]
    quat_wxyz: tuple[float, float, float, float]


MOUNTS: dict[str, Mount] = {
    # x_hand = z7, y_hand = -y7, z_hand = x7. The palm's centre, 47.5 mm below the finger bases, is on the
    # flange axis.
    "palm_normal": Mount((0.0475, 0.0, 0.15), (0.0, _HALF, 0.0, _HALF)),
    # z_hand = z7, turned -45 deg about it. The palm's bottom, 95 mm below the finger bases, is 0.12 m from
    # link 7.
    "fingers_along": Mount((0.0, 0.0, 0.215), (_COS_EIGHTH, 0.0, 0.0, -_SIN_EIGHTH)),
}
"""The known mounts. `palm_normal` reaches more of a table from above; the other is there to compare with."""


def find_mount(name: str) -> Mount:
    """Return the mount of that name.

    Raises:
        InputError: if there is none.
    """
    if name not in MOUNTS:
        raise unknown_name("mount", name, MOUNTS)
    return MOUNTS[name]
