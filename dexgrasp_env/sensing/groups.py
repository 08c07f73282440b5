"""Which geoms a camera sees, by MuJoCo's geom groups."""

import numpy as np
from numpy.typing import NDArray

VISUAL_GROUPS = (0, 1, 2)
"""Geom groups a camera sees; collision geoms are in group 3."""


def group_mask(groups: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return MuJoCo's six flags, one a geom group."""
    return np.isin(np.arange(6), groups).astype(np.uint8)
