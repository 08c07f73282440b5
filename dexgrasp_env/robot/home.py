"""Where every episode begins: the arm ready, the hand open."""

import numpy as np

from dexgrasp_env.arrays import Array


def table(*values: float) -> Array:
    """Return a read-only array: the tables are shared by everybody."""
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


HOME_ARM = table(0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4)
"""The arm's ready configuration, (7,) rad."""
OPEN_HAND = table(*(0.0, 0.8, 0.4, 0.3) * 3, 1.35, 0.4, 0.2, 0.25)
"""An open hand with the thumb opposite the fingers, (16,) rad: the pre-shape of a grasp."""
HOME = table(*HOME_ARM, *OPEN_HAND)
"""Home arm and open hand, (23,) rad."""
