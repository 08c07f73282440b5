"""The array type of this project (metres, radians, whatever shape the docstring says), and even directions."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def fibonacci_directions(count: int) -> Array:
    """Return (count, 3) unit vectors spread evenly over the sphere, always the same."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * index
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=-1)
