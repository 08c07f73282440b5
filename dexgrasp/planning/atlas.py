"""An atlas of three-finger hand postures, looked up by the triangle that the fingertips make.

Three fingertip positions fix the palm pose of a posture whose tips make the same triangle, so a proposal becomes whole
hand configurations by a neighbour search and one rigid alignment, without iteration.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numba import njit
from scipy.spatial import KDTree

from dexgrasp.kinematics.forward import empty_frames, forward, tip_positions
from dexgrasp.kinematics.tree import RobotTree, robot_tree
from dexgrasp_env.arrays import Array
from dexgrasp_env.files import cached_arrays, content_hash
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.robot import Robot

_VERSION = 5
_SAMPLES = 400_000
_RANGE = 0.92  # share of each joint's range that is sampled: the optimiser needs room to move
_SIDE = (0.024, 0.20)  # m, sides of the triangles kept


@dataclass(frozen=True)
class HandAtlas:
    """N postures; every array is in the palm frame.

    Attributes:
        joints: (N, h) rad, of the hand; idle fingers are out of the way.
        tips: (N, 3, 3) m, tip centres of thumb, index, middle.
        axes: (N, 3, 3), fingertip axes, pointing out of the tip.
        pads: (N, 3, 3), directions that the pads face.
        search: KD-tree over the triangle's sides, m.
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
    key = content_hash(_VERSION, _SAMPLES, seed, tree.offset, tree.rotation, tree.lower, tree.upper)
    found = cached_arrays(f"hand_atlas_{key}.npy", lambda: _made(cell.robot, tree, seed))
    # A tree that is not balanced takes half the time, its queries no longer.
    search = KDTree(triangle_sides(found["tips"]), leafsize=16, balanced_tree=False, compact_nodes=False)
    return HandAtlas(**found, search=search)


def _made(robot: Robot, tree: RobotTree, seed: int) -> dict[str, Array]:
    """Draw postures in which the thumb faces the two fingers and no tips meet."""
    rng = np.random.default_rng(seed)
    lower, upper = tree.lower[tree.arm :], tree.upper[tree.arm :]
    middle, half = 0.5 * (lower + upper), 0.5 * _RANGE * (upper - lower)
    q = np.tile(tree.home, (_SAMPLES, 1))
    q[:, tree.arm :] = middle + half * rng.uniform(-1.0, 1.0, (_SAMPLES, len(lower)))
    for finger in robot.hand.fingers:
        if finger.name not in robot.hand.grasp and finger.aside:
            q[:, robot.columns[finger.name]] = finger.aside
    tips, axes, pads = _tip_frames(q, tree)
    sides = triangle_sides(tips)
    inside = ((sides > [_SIDE[0] + 0.006, _SIDE[0] + 0.006, 0.030]) & (sides < _SIDE[1])).all(1)
    between = 0.5 * (tips[:, 1] + tips[:, 2]) - tips[:, 0]
    between /= np.linalg.norm(between, axis=1, keepdims=True)
    opposed = (pads[:, 0] * between).sum(1) > 0.1
    opposed &= ((pads[:, 1] * between).sum(1) < 0.2) & ((pads[:, 2] * between).sum(1) < 0.2)
    kept = inside & opposed & (tips[:, :, 0] > 0.02).all(1)  # in front of the palm
    return {"joints": q[kept, tree.arm :], "tips": tips[kept], "axes": axes[kept], "pads": pads[kept]}


def triangle_sides(corners: Array) -> Array:
    """Return the sides (..., 3) m of triangles (..., 3, 3): thumb-index, thumb-middle, index-middle."""
    sides: Array = np.linalg.norm(corners[..., [0, 0, 1], :] - corners[..., [1, 2, 2], :], axis=-1)
    return sides


@njit(cache=True)
def _all_tips(q: Array, tree: RobotTree, tips: Array, axes: Array, pads: Array) -> None:
    frames = empty_frames(tree)
    R, p = frames.R, frames.p
    for k in range(q.shape[0]):
        forward(q[k], tree, frames)
        palm = R[tree.palm] @ tree.palm_rotation
        origin = p[tree.palm] + R[tree.palm] @ tree.palm_offset
        world = tip_positions(tree, frames)
        for i in range(3):
            tips[k, i] = palm.T @ (world[i] - origin)
            axes[k, i] = palm.T @ np.ascontiguousarray(R[tree.tip_body[i], :, 2])
            pads[k, i] = palm.T @ np.ascontiguousarray(R[tree.tip_body[i], :, 0])


def _tip_frames(q: Array, tree: RobotTree) -> tuple[Array, Array, Array]:
    shape = (len(q), 3, 3)
    tips, axes, pads = np.empty(shape), np.empty(shape), np.empty(shape)
    _all_tips(q, tree, tips, axes, pads)
    return tips, axes, pads
