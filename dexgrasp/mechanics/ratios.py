"""Force ratio and torque ratio: how much of the contacts' effort is left unbalanced.

Our own definitions, as the paper does not give its own: force ratio = |sum f_i| / sum |f_i|, torque ratio =
|sum (p_i - c) x f_i| / sum |(p_i - c) x f_i|, c the object's centroid; both in percent, 0 for closure.
"""

import numpy as np

from dexgrasp_env.arrays import Array


def _ratio(vectors: Array) -> float:
    total = np.sqrt((vectors**2).sum(-1)).sum()
    return float(100.0 * np.sqrt((vectors.sum(0) ** 2).sum()) / total) if total > 0 else 0.0


def wrench_ratios(points: Array, forces: Array, centroid: Array) -> tuple[float, float]:
    """Return force and torque ratio [%] of forces (N, 3) at points (N, 3); `centroid` (3,) of the object."""
    return _ratio(forces), _ratio(np.cross(points - centroid, forces))
