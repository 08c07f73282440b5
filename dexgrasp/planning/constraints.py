"""The constraints of the bilevel optimisation and their gradients at one configuration, compiled.

Every constraint is written c(q) >= 0 in metres or scaled to them: fingertip distances within [d_min, d_max] (section
1.2), margin of force closure, the lower problem (Eq. 4 with a margin), orientation of the tips, clearances. Joint
limits are bounds of the SQP's quadratic programme (QP), and the arm is part of q, so reachability needs no constraint
of its own.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp.geometry.convex_kernel import Obstacle, convex_distance_hessian
from dexgrasp.geometry.triangle import cross
from dexgrasp.mechanics.contacts import Shape
from dexgrasp.mechanics.kinematics.clearance import TABLE, Rows, clearance_rows
from dexgrasp.mechanics.kinematics.forward import (
    Frames,
    add_turn_row,
    empty_frames,
    forward,
    tip_jacobian,
    tip_positions,
)
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp.mechanics.kinematics.world import World
from dexgrasp.mechanics.margin import cone_margin
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import njit

MAX_ROWS = 96
MARGIN_SCALE = 0.02  # m a unit of closure margin: a tenth of margin weighs as much as 2 mm
ANGLE_SCALE = 0.01  # m a unit of cosine
_ACTIVATION = 0.02  # m: clearances beyond have no say in this step


def fixed_rows(tips: int) -> tuple[int, int, int, int]:
    """Return the rows of closure, of the first tip axis and of the first pad, and how many are fixed.

    Before them are the tips' least distances, and their largest.
    """
    return 2 * tips, 2 * tips + 1, 3 * tips + 1, 4 * tips + 1


class Bounds(NamedTuple):
    """Thresholds of the constraints; lengths in m."""

    low: float  # of a tip centre's distance from the surface
    high: float
    margin: float
    cosine: float  # of tip axis to inward normal
    pad_cosine: float  # of pad direction to inward normal
    clearance: float
    off_table: float  # the clearance from the table
    friction: float


class Evaluation(NamedTuple):
    """Constraints at one configuration."""

    values: Array  # (k,) >= 0 where satisfied
    rows: Array  # (k, n) gradients
    labels: Index  # (k, 3): kind (see clearance.KINDS) and bodies; -1 - k for the fixed row k
    contacts: Array  # (g, 3) m
    normals: Array  # (g, 3) out of the object
    distances: Array  # (g,) m, of the tip sphere centres
    margin: float
    metric: Array  # (n, n) m^2/rad^2: dq^T metric dq is how far fingertips slide over the surface, squared


class _Touch(NamedTuple):
    """Contacts of the fingertips on the object, with gradients."""

    contacts: Array  # (g, 3) m, the surface's points nearest to the tip centres
    normals: Array  # (g, 3) out of the object
    distances: Array  # (g,) m, of the tip centres
    hessians: Array  # (g, 3, 3) of the distances, 1/m
    jacobians: Array  # (g, 3, n) of the tip centres, m/rad


@njit
def evaluate(
    q: Array, tree: RobotTree, obstacle: Obstacle, world: World, bounds: Bounds, shape: Shape,
    with_margin: bool,
) -> Evaluation:  # fmt: skip
    """Evaluate all constraints and gradients at `q` (n,) rad.

    Args:
        q: (n,) rad.
        tree: the robot.
        obstacle: the object in the world frame.
        world: the robot's shapes, the object and what stands around it.
        bounds: thresholds.
        shape: of the contacts.
        with_margin: whether the closure margin counts (ablation `cvae_kinematics` leaves it out).
    """
    frames = empty_frames(tree)
    forward(q, tree, frames)
    touch = _touch(tree, frames, obstacle)
    rows = Rows(
        np.full(MAX_ROWS, 1.0), np.zeros((MAX_ROWS, q.shape[0])), np.full((MAX_ROWS, 3), -1, dtype=np.int64)
    )
    g = shape.contacts
    fixed = 4 * g + 1
    for i in range(g):
        gradient = touch.normals[i] @ touch.jacobians[i]
        rows.values[i], rows.gradients[i] = touch.distances[i] - bounds.low, gradient
        rows.values[g + i], rows.gradients[g + i] = bounds.high - touch.distances[i], -gradient
        _direction_rows(i, tree, frames, touch, bounds, rows)
    margin = 1.0
    if with_margin:
        margin = _closure_row(touch, bounds, shape, rows)
    for k in range(fixed):
        rows.labels[k, 0] = -1 - k
    beyond = Rows(rows.values[fixed:], rows.gradients[fixed:], rows.labels[fixed:])
    total = fixed + clearance_rows(tree, frames, world, _ACTIVATION, True, beyond)
    for k in range(fixed, total):
        rows.values[k] -= bounds.off_table if rows.labels[k, 0] == TABLE else bounds.clearance
    return Evaluation(
        rows.values[:total], rows.gradients[:total], rows.labels[:total],
        touch.contacts, touch.normals, touch.distances, margin, _slide(touch),
    )  # fmt: skip


@njit
def _slide(touch: _Touch) -> Array:
    """Return sum J_i^T (I - n n^T) J_i."""
    n = touch.jacobians.shape[2]
    metric = np.zeros((n, n))
    for i in range(len(touch.normals)):
        J, normal = touch.jacobians[i], touch.normals[i]
        along = J - np.outer(normal, normal @ J)
        metric += along.T @ along
    return metric


@njit
def _touch(tree: RobotTree, frames: Frames, obstacle: Obstacle) -> _Touch:
    tips = tip_positions(tree, frames)
    g = len(tips)
    contacts, normals, distances = np.empty((g, 3)), np.empty((g, 3)), np.empty(g)
    hessians = np.empty((g, 3, 3))
    for i in range(g):
        distances[i] = convex_distance_hessian(tips[i], obstacle, normals[i], hessians[i])
        contacts[i] = tips[i] - distances[i] * normals[i]
    return _Touch(contacts, normals, distances, hessians, tip_jacobian(tree, frames, tips))


@njit
def _closure_row(touch: _Touch, bounds: Bounds, shape: Shape, rows: Rows) -> float:
    """Row of the lower problem, by the envelope theorem; return the closure margin."""
    margin, by_point, by_normal, _ = cone_margin(touch.contacts, touch.normals, bounds.friction, shape)
    row = 2 * shape.contacts
    rows.values[row] = MARGIN_SCALE * (margin - bounds.margin)
    for i in range(shape.contacts):
        n, H = touch.normals[i], touch.hessians[i]
        # contact = tip - d n: a shift of the tip moves the contact along the surface and turns the normal.
        along = by_point[i] - n * (n @ by_point[i]) - touch.distances[i] * (H @ by_point[i])
        g = along + H @ by_normal[i]
        rows.gradients[row] += MARGIN_SCALE * (g @ touch.jacobians[i])
    return margin


@njit
def _direction_rows(
    i: int, tree: RobotTree, frames: Frames, touch: _Touch, bounds: Bounds, rows: Rows
) -> None:
    """Rows that keep the inward normal on the front (axis z) and on the pad's side (x) of a fingertip."""
    body, inward, g = tree.tip_body[i], -touch.normals[i], len(touch.normals)
    for row, column, threshold in ((2 * g + 1 + i, 2, bounds.cosine), (3 * g + 1 + i, 0, bounds.pad_cosine)):
        direction, turn = frames.R[body, :, column].copy(), np.empty(3)
        rows.values[row] = ANGLE_SCALE * ((direction * inward).sum() - threshold)
        # d(a . m) = (w x a) . m + a . dm = w . (a x m) + a . dm
        cross(direction, inward, turn)
        add_turn_row(rows.gradients[row], body, turn, ANGLE_SCALE, tree, frames)
        rows.gradients[row] -= ANGLE_SCALE * ((touch.hessians[i] @ direction) @ touch.jacobians[i])
