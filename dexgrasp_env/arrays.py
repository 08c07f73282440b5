"""The array type of this project: lengths in metres, angles in radians, whatever shape the docstring says."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
