"""The walls of a hollow thing as convex parts: what its hull fills is left open, so that fingers may go inside."""

import numpy as np

from dexgrasp_env.arrays import Array, middle

LOW = 0.030
"""m above the table, up to which nothing that is open above has room for a fingertip."""


def walls_of(points: Array) -> list[Array]:
    """Return the corners (N, 3) m of convex parts whose union is the walls that a cloud shows, and what is below them.

    Rows of parts go around the upright axis through the middle of the cloud, from the rim down, each part short enough
    that it hardly bulges inwards. What lies deeper than a finger reaches is one part, down to the table. What is closed
    above is not hollow to them: there a part reaches to the middle.

    Args:
        points: (M, 3) m of the surface, seen all round and from above, the table's top at z = 0.
    """
    height = points[:, 2]
    rim = float(np.percentile(height, 99.0))
    if rim < LOW:
        return []
    from_middle = points[:, :2] - middle(points[:, :2])
    angle, radius = np.arctan2(from_middle[:, 1], from_middle[:, 0]), np.linalg.norm(from_middle, axis=1)
    # Parts have 40 mm of the outline; not more of them than a grasp file takes.
    count = int(np.clip(np.ceil(2.0 * np.pi * radius.max() / 0.040), 6, 18))
    found = []
    tiers = 3  # below the rim: a finger reaches no deeper
    overlap = 0.006  # m that parts reach beyond their edges
    row_height = 0.022  # m
    for tier in range(tiers):
        low, high = rim - (tier + 1) * row_height, np.inf if tier == 0 else rim - tier * row_height
        held = (height > low - overlap) & (height < high + overlap)
        row, turned = points[held], angle[held]
        for turn in 2.0 * np.pi * np.arange(count) / count:
            off = np.abs((turned - turn + np.pi) % (2.0 * np.pi) - np.pi)
            found.append(row[off < np.pi / count + overlap / radius.max()])
    below = points[height < rim - tiers * row_height + overlap]
    found.append(np.concatenate([below, below * [1.0, 1.0, 0.0]]))
    return [part for part in found if len(part) >= 8]
