"""An atlas of hand postures, looked up by the triangle that the first three fingertips make, or by the gap of two.

Three fingertip positions fix the palm pose of a posture whose tips make the same triangle, so a proposal becomes whole
hand configurations by a neighbour search and one rigid alignment, without iteration. Two leave a turn about their line.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.spatial import KDTree

from dexgrasp.kinematics.forward import empty_frames, forward, forward_part, tip_positions
from dexgrasp.kinematics.tree import RobotTree, robot_tree
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit
from dexgrasp_env.files import Arrays, cache_dir, cached_arrays, content_hash
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.robot import Robot

_VERSION = 6
SAMPLES = 400_000
_RANGE = 0.92  # share of each joint's range that is sampled: the optimiser needs room to move
_SIDE = (0.024, 0.20)  # m, sides of the triangles kept


@dataclass(frozen=True)
class HandAtlas:
    """N postures; every array is in the palm frame.

    Attributes:
        joints: (N, h) rad, of the hand; idle fingers are out of the way.
        tips: (N, g, 3) m, tip centres of the grasping fingers, the opposing one first.
        axes: (N, g, 3), fingertip axes, pointing out of the tip.
        pads: (N, g, 3), directions that the pads face.
        search: KD-tree over `triangle_sides`, m.
    """

    joints: Array
    tips: Array
    axes: Array
    pads: Array
    search: KDTree


@lru_cache(maxsize=4)
def hand_atlas(cell: Cell, seed: int = 0) -> HandAtlas:
    """Return the atlas of a robot's hand, sampled with `seed` and kept in the cache; mount and table do not matter."""
    cell = replace(cell, table_height=0.0).mounted(cell.mounts[0])
    tree = robot_tree(cell)
    drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, (SAMPLES, len(tree.lower) - tree.arm))
    key = content_hash(
        _VERSION, SAMPLES, seed, tree.offset, tree.rotation, tree.lower, tree.upper, tree.tip_body
    )
    file = cached_arrays(f"postures_{key}.npy", lambda: _kept(drawn, cell.robot, tree))
    q = _postures(drawn[np.unpackbits(file["kept"], count=SAMPLES) == 1], cell.robot, tree)
    tips, axes, pads = _tip_frames(q, tree)
    # A tree that is not balanced takes half the time, its queries no longer.
    search = KDTree(triangle_sides(tips), leafsize=16, balanced_tree=False, compact_nodes=False)
    return HandAtlas(q[:, tree.arm :].copy(), tips, axes, pads, search)


def triangle_sides(corners: Array) -> Array:
    """Return the sides (..., 3) m of the first three corners (..., g, 3): 0-1, 0-2, 1-2; of two the one there is."""
    one, other = ([0, 0, 1], [1, 2, 2]) if corners.shape[-2] > 2 else ([0], [1])
    sides: Array = np.linalg.norm(corners[..., one, :] - corners[..., other, :], axis=-1)
    return sides


def _postures(drawn: Array, robot: Robot, tree: RobotTree) -> Array:
    """Return postures (N, n) rad of draws (N, h) from -1 to 1; the arm is at home, idle fingers are out of the way."""
    lower, upper = tree.lower[tree.arm :], tree.upper[tree.arm :]
    q = np.tile(tree.home, (len(drawn), 1))
    share = np.where(tree.unit[tree.arm :] < 1.0, 1.0, _RANGE)  # slides open as wide as they can
    q[:, tree.arm :] = 0.5 * (lower + upper) + 0.5 * share * (upper - lower) * drawn
    for finger in robot.hand.fingers:
        if finger.name not in robot.hand.grasp and finger.aside:
            q[:, robot.columns[finger.name]] = finger.aside
    for j in np.flatnonzero(tree.follows >= 0):
        q[:, j] = tree.ratio[j, 0] * q[:, tree.follows[j]] + tree.ratio[j, 1]
    return q


def _kept(drawn: Array, robot: Robot, tree: RobotTree) -> Arrays:
    """Return, as bits, in which postures the first finger faces the others and no tips meet: what is worth a file."""
    for old in cache_dir().glob("hand_atlas_*.npy"):  # of 0.2.0: 54 MB each
        old.unlink(missing_ok=True)
    tips, _, pads = _tip_frames(_postures(drawn, robot, tree), tree)
    sides = triangle_sides(tips)
    least = [_SIDE[0] + 0.006, _SIDE[0] + 0.006, 0.030] if sides.shape[1] == 3 else [_SIDE[0]]
    inside = ((sides > least) & (sides < _SIDE[1])).all(1)
    between = tips[:, 1:3].mean(1) - tips[:, 0]
    between /= np.linalg.norm(between, axis=1, keepdims=True)
    opposed = (pads[:, 0] * between).sum(1) > 0.1
    for i in range(1, tips.shape[1]):
        opposed &= (pads[:, i] * between).sum(1) < 0.2
    in_front = (tips[:, :, 0] > 0.02).all(1)
    return {"kept": np.packbits(inside & opposed & in_front)}


@njit
def _all_tips(q: Array, tree: RobotTree, tips: Array, axes: Array, pads: Array) -> None:
    frames = empty_frames(tree)
    R, p = frames.R, frames.p
    forward(q[0], tree, frames)
    palm = R[tree.palm] @ tree.palm_rotation  # the arm stands still
    origin = p[tree.palm] + R[tree.palm] @ tree.palm_offset
    for k in range(q.shape[0]):
        forward_part(q[k], tree, frames, tree.palm + 1, R.shape[0])
        away = tip_positions(tree, frames) - origin
        for i in range(tips.shape[1]):
            tip = R[tree.tip_body[i]]
            for r in range(3):
                x, y, z = palm[0, r], palm[1, r], palm[2, r]
                tips[k, i, r] = x * away[i, 0] + y * away[i, 1] + z * away[i, 2]
                axes[k, i, r] = x * tip[0, 2] + y * tip[1, 2] + z * tip[2, 2]
                pads[k, i, r] = x * tip[0, 0] + y * tip[1, 0] + z * tip[2, 0]


def _tip_frames(q: Array, tree: RobotTree) -> tuple[Array, Array, Array]:
    shape = (len(q), len(tree.tip_body), 3)
    tips, axes, pads = np.empty(shape), np.empty(shape), np.empty(shape)
    _all_tips(q, tree, tips, axes, pads)
    return tips, axes, pads
