"""The constraints of the bilevel programme and their gradients at one configuration, compiled.

Every constraint is written c(q) >= 0 in metres or scaled to them: fingertip distances within [d_min, d_max] (section
1.2), closure margin of the lower problem (Eq. 4 with a margin), orientation of the tips, clearances. Joint limits are
bounds of the quadratic programme, and the arm is part of q, so reachability needs no constraint of its own.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from agents.geometry.convex_kernel import convex_distance_hessian
from agents.kinematics.clearance import clearance_rows
from agents.kinematics.forward import add_turn_row, forward, tip_jacobian, tip_positions
from agents.kinematics.tree import RobotTree
from agents.physics.margin import cone_margin
from dexgrasp_env.arrays import Array

MAX_ROWS = 96
FIXED_ROWS = 13  # 3 distances low, 3 high, closure, 3 axes, 3 pads
CLOSURE, FIRST_AXIS, FIRST_PAD = 6, 7, 10
MARGIN_SCALE = 0.02  # m a unit of closure margin: a tenth of margin weighs as much as 2 mm
ANGLE_SCALE = 0.01  # m a unit of cosine
_ACTIVATION = 0.02  # m: clearances beyond have no say in this step


class Bounds(NamedTuple):
    """Thresholds of the constraints; lengths in m."""

    low: float  # of a tip centre's distance from the surface
    high: float
    margin: float
    cosine: float  # of tip axis to inward normal
    pad_cosine: float  # of pad direction to inward normal
    clearance: float
    friction: float


class Evaluation(NamedTuple):
    """Constraints at one configuration."""

    values: Array  # (n,) >= 0 where satisfied
    rows: Array  # (n, 23) gradients
    labels: NDArray[np.int64]  # (n, 3): kind (see clearance.KINDS) and bodies; -1 - k for the fixed row k
    contacts: Array  # (3, 3) m
    normals: Array  # (3, 3) out of the object
    distances: Array  # (3,) m, of the tip sphere centres
    margin: float


@njit(cache=True, error_model="numpy")
def evaluate(
    q: Array, tree: RobotTree, triangles: Array, planes: Array, bounds: Bounds, with_margin: bool
) -> Evaluation:
    """Evaluate all constraints and gradients at `q` (23,) rad.

    Args:
        q: (23,) rad.
        tree: the robot.
        triangles: (F, 3, 3) and
        planes: (F, 4), the object in the robot base frame.
        bounds: thresholds.
        with_margin: whether the closure margin counts (ablation `cvae_kinematics` leaves it out).
    """
    nb = tree.parent.shape[0]
    R, p = np.empty((nb, 3, 3)), np.empty((nb, 3))
    forward(q, tree, R, p)
    tips = tip_positions(tree, R, p)
    J = tip_jacobian(tree, R, p, tips)
    values, rows = np.full(MAX_ROWS, 1.0), np.zeros((MAX_ROWS, 23))
    labels = np.full((MAX_ROWS, 3), -1, dtype=np.int64)
    contacts, normals, distances = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    hessians = np.empty((3, 3, 3))
    for i in range(3):
        d = convex_distance_hessian(tips[i], triangles, planes, normals[i], hessians[i])
        distances[i] = d
        contacts[i] = tips[i] - d * normals[i]
        gradient = normals[i] @ J[i]
        values[i], rows[i] = d - bounds.low, gradient
        values[3 + i], rows[3 + i] = bounds.high - d, -gradient
        _direction_rows(i, tree, R, J, normals, hessians, bounds, values, rows)
    margin = 1.0
    if with_margin:
        margin, by_point, by_normal = cone_margin(contacts, normals, bounds.friction)
        values[CLOSURE] = MARGIN_SCALE * (margin - bounds.margin)
        for i in range(3):
            n, H = normals[i], hessians[i]
            # contact = tip - d n: a shift of the tip moves the contact along the surface and turns the normal.
            g = by_point[i] - n * (n @ by_point[i]) - distances[i] * (H @ by_point[i]) + H @ by_normal[i]
            rows[CLOSURE] += MARGIN_SCALE * (g @ J[i])
    for k in range(FIXED_ROWS):
        labels[k, 0] = -1 - k
    n = clearance_rows(
        tree,
        R,
        p,
        triangles,
        planes,
        _ACTIVATION,
        True,
        True,
        values[FIXED_ROWS:],
        rows[FIXED_ROWS:],
        labels[FIXED_ROWS:],
    )
    total = FIXED_ROWS + n
    for k in range(FIXED_ROWS, total):
        values[k] -= bounds.clearance
    return Evaluation(values[:total], rows[:total], labels[:total], contacts, normals, distances, margin)


@njit(cache=True, error_model="numpy")
def _direction_rows(
    i: int,
    tree: RobotTree,
    R: Array,
    J: Array,
    normals: Array,
    hessians: Array,
    bounds: Bounds,
    values: Array,
    rows: Array,
) -> None:
    """Rows that keep the inward normal on the front (axis z) and on the pad's side (x) of a fingertip."""
    body = tree.tip_body[i]
    for row, column, threshold in ((FIRST_AXIS + i, 2, bounds.cosine), (FIRST_PAD + i, 0, bounds.pad_cosine)):
        direction = np.empty(3)
        for r in range(3):
            direction[r] = R[body, r, column]
        inward = -normals[i]
        values[row] = ANGLE_SCALE * ((direction * inward).sum() - threshold)
        # d(a . m) = (w x a) . m + a . dm = w . (a x m) + a . dm
        turn = np.array([
            direction[1] * inward[2] - direction[2] * inward[1],
            direction[2] * inward[0] - direction[0] * inward[2],
            direction[0] * inward[1] - direction[1] * inward[0],
        ])  # fmt: skip
        add_turn_row(rows[row], body, turn, ANGLE_SCALE, tree, R)
        rows[row] -= ANGLE_SCALE * ((hessians[i] @ direction) @ J[i])
