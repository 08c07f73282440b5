"""An atlas of hand postures, looked up by the triangle that the first three fingertips make, or by the gap of two.

Three fingertip positions fix the palm pose of a posture whose tips make the same triangle, so a proposal becomes whole
hand configurations by a neighbour search and one rigid alignment, without iteration. Two leave a turn about their line.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from dexgrasp.mechanics.kinematics.clearance import place, place_body, self_clearance, table_clearance
from dexgrasp.mechanics.kinematics.forward import empty_frames, forward, forward_part, tip_positions
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.mechanics.kinematics.world import World, make_world
from dexgrasp_env.arrays import Array, Arrays, Index, Mask, unit
from dexgrasp_env.compiled import njit
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import cached_arrays, content_hash
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.robot import Robot

_VERSION = 8
SAMPLES = 400_000
_SEED = 0
_ENOUGH, _ROUNDS = 20_000, 30  # postures of a hand from elsewhere that will do; how often to sample for them
_STEP = 0.15  # how far to draw from those that are near, of half a range
_APART = 0.003  # m between its bodies, so that it can open too
_LOOKED_AT = 500  # postures that tell which of its bodies can be so far apart
_INWARD = -0.2  # least cosine of its tips' axes to the middle of all tips: the backs of tips cannot press
_BESIDE, _DEPTH = 0.003, 0.005  # m that the link behind a tip may lie in a face that the tip presses so deep
_LEAST = 0.05  # cosine of a tip's axis to what it presses against
_SQUARE = 0.7  # the like, of a jaw's tip to a face square to the way that it closes
_RANGE = 0.92  # share of each joint's range that is sampled: the optimiser needs room to move
_SIDE = (0.024, 0.20)  # m, sides of the triangles kept


class Tips(NamedTuple):
    """Tips of the grasping fingers in N postures, or in one, the opposing one first, in the palm frame."""

    centres: Array  # (N, g, 3) m
    axes: Array  # (N, g, 3), pointing out of the tip
    pads: Array  # (N, g, 3), directions that the pads face
    least: float  # cosine of a tip's axis to what it presses against


class HandAtlas(NamedTuple):
    """N postures of a hand."""

    joints: Array  # (N, h) rad; idle fingers are out of the way
    tips: Tips
    search: KDTree  # over `triangle_sides`, m
    frames: Array  # (N, 3, 3) `triangle_frames`; of two tips the third corner is where their axes meet or so
    middles: Array  # (N, 3) m, of the first three tips, or two


@lru_cache(maxsize=8)  # hashing the cell that is looked up takes 0.2 ms, eleven times a plan
def hand_atlas(cell: Cell) -> HandAtlas:
    """Return the atlas of a robot's hand, sampled once and kept in the cache; mount and table do not matter."""
    return _atlas(replace(cell, table_height=0.0, table=None).mounted(cell.mounts[0]))


@lru_cache(maxsize=4)
def _atlas(cell: Cell) -> HandAtlas:
    robot, tree, rng = cell.robot, robot_tree(cell), np.random.default_rng(_SEED)
    world = make_world(cell)

    def sampled() -> Arrays:
        """Return postures with what would take longer to make again than to read."""
        if robot.hand.frame is not None:
            q = _many_kept(rng, robot, tree, world)
        else:
            drawn = _drawn(rng, tree)
            q = _postures(drawn[_opposed(_postures(drawn, robot, tree), tree)], robot, tree)
        centres, axes, pads = _tip_frames(q, tree)
        tips = {"centres": centres, "axes": axes, "pads": pads, "sides": triangle_sides(centres)}
        return tips | {"joints": q[:, tree.arm :].copy()}

    found = cached_arrays(f"postures_{_key(robot, tree, world)}.npy", sampled)
    tips = Tips(found["centres"], found["axes"], found["pads"], _least_facing(tree, world))
    # A tree that is not balanced takes half the time, its queries no longer.
    search = KDTree(found["sides"], leafsize=16, balanced_tree=False, compact_nodes=False)
    corners = tips.centres[:, :3]
    frames = triangle_frames(corners, tips.axes[:, :2].sum(1))
    return HandAtlas(found["joints"], tips, search, frames, corners.mean(1))


def _key(robot: Robot, tree: RobotTree, world: World) -> str:
    """Return a hash of all that the postures of a hand depend on."""
    hand = robot.hand
    places = tree.offset, tree.rotation, tree.lower, tree.upper, tree.tip_body, tree.tip_offset, *robot.drive
    shapes = world.position, world.reach, tree.pairs, [finger.aside for finger in hand.fingers]
    foreign = () if hand.frame is None else (_ENOUGH, _STEP, hand.stamp, *hand.tendons)
    return content_hash(_VERSION, SAMPLES, _SEED, *places, *shapes, *foreign)


def triangle_sides(corners: Array) -> Array:
    """Return the sides (..., 3) m of the first three corners (..., g, 3): 0-1, 0-2, 1-2; of two the one there is."""
    one, other = ([0, 0, 1], [1, 2, 2]) if corners.shape[-2] > 2 else ([0], [1])
    return np.linalg.norm(corners[..., one, :] - corners[..., other, :], axis=-1)


def triangle_frames(corners: Array, third: Array) -> Array:
    """Return axes (M, 3, 3) as columns of triangles: along the first side, in it, and out of it.

    Args:
        corners: (M, n, 3), three of them, or two.
        third: (M, 3) on which way from the first the third corner is, where there are but two.
    """
    x = unit(corners[:, 1] - corners[:, 0])
    z = unit(np.cross(x, corners[:, 2] - corners[:, 0] if corners.shape[1] > 2 else third))
    return np.stack([x, np.cross(z, x), z], axis=2)


def _postures(drawn: Array, robot: Robot, tree: RobotTree) -> Array:
    """Return postures (N, n) rad of draws (N, h) from -1 to 1; the arm is at home, idle fingers are out of the way."""
    lower, upper = tree.lower[tree.arm :], tree.upper[tree.arm :]
    q = np.tile(tree.home, (len(drawn), 1))
    share = np.where(tree.unit[tree.arm :] < 1.0, 1.0, _RANGE)  # slides open as wide as they can
    q[:, tree.arm :] = 0.5 * (lower + upper) + 0.5 * share * (upper - lower) * drawn
    for finger in robot.hand.fingers:
        if finger.name not in robot.hand.grasp and finger.aside:
            q[:, robot.columns[finger.name]] = finger.aside
    C, c = robot.drive
    for j in np.flatnonzero(tree.follows >= 0):
        q[:, j] = q @ C[j] + c[j]
    return q


def _drawn(rng: np.random.Generator, tree: RobotTree) -> Array:
    return rng.uniform(-1.0, 1.0, (SAMPLES, len(tree.lower) - tree.arm))


def _near_draws(rng: np.random.Generator, drawn: Array) -> Array:
    """Return draws near some of others (N, h)."""
    near = drawn[rng.integers(len(drawn), size=SAMPLES)]
    return np.clip(near + rng.normal(0.0, _STEP, near.shape), -1.0, 1.0)


def _many_kept(rng: np.random.Generator, robot: Robot, tree: RobotTree, world: World) -> Array:
    """Return postures (N, n) rad of a hand from elsewhere that it can take, open and press in: few of those drawn.

    Where all rounds would bring too few, further ones draw around those that come nearest to it.
    """
    kept, pairs, drawn, few = list[Array](), _moving_pairs(robot, tree), _drawn(rng, tree), False
    for k in range(_ROUNDS):
        q = _postures(drawn, robot, tree)
        opposed = np.flatnonzero(_opposed(q, tree))
        if k == 0:
            pairs = _telling(q[opposed[:_LOOKED_AT]], tree, world, pairs)
        inward = opposed[_inward(q[opposed], tree)]
        found = inward[_clear_of_itself(q[inward], tree, world, pairs)]
        kept.append(q[found])
        if sum(map(len, kept)) > _ENOUGH:
            break
        few = few or (k == 0 and _ROUNDS * len(found) < _ENOUGH)
        nearest = next((own for own in (found, inward, opposed) if len(own)), opposed)
        drawn = _near_draws(rng, drawn[nearest]) if few and len(nearest) else _drawn(rng, tree)
    if not sum(map(len, kept)):
        raise InputError(f"hand {robot.hand.name!r} can press with no two tips: see `dexgrasp robot check`")
    return np.concatenate(kept)


def _telling(q: Array, tree: RobotTree, world: World, pairs: Index) -> Index:
    """Return the pairs of bodies that some of postures (N, n) keep apart: `_APART` is more than others ever are."""
    kept = [len(q) == 0 or bool(_clear_of_itself(q, tree, world, pair[None]).any()) for pair in pairs]
    return pairs[np.array(kept, bool)]


def _moving_pairs(robot: Robot, tree: RobotTree) -> Index:
    """Return the pairs of the hand's bodies whose distance depends on the fingers of a grasp."""
    still = {robot.hand.palm} | {
        body for finger in robot.hand.fingers if finger.name not in robot.hand.grasp for body in finger.bodies
    }
    resting = np.isin(tree.pairs, [robot.bodies.index(name) for name in still]).all(1)
    return tree.pairs[(tree.pairs.min(1) >= tree.palm) & ~resting]


def _opposed(q: Array, tree: RobotTree) -> Mask:
    """Return in which postures the first finger faces the others and no tips meet."""
    tips, _, pads = _tip_frames(q, tree)
    sides = triangle_sides(tips)
    least = [_SIDE[0] + 0.006, _SIDE[0] + 0.006, 0.030] if sides.shape[1] == 3 else [_SIDE[0]]
    inside = ((sides > least) & (sides < _SIDE[1])).all(1)
    between = unit(tips[:, 1:3].mean(1) - tips[:, 0])
    along = (pads * between[:, None]).sum(2)
    opposed = (along[:, 0] > 0.1) & (along[:, 1:] < 0.2).all(1)
    in_front = (tips[..., 0] > 0.02).all(1)
    return inside & opposed & in_front


def _inward(q: Array, tree: RobotTree) -> Mask:
    """Return in which postures no tip turns its back to what is between them."""
    if not len(q):
        return np.zeros(0, bool)
    tips, axes, _ = _tip_frames(q, tree)
    towards = unit(tips.mean(1, keepdims=True) - tips)
    inward: Mask = ((axes * towards).sum(2) > _INWARD).all(1)
    return inward


@njit
def _clear_of_itself(q: Array, tree: RobotTree, world: World, pairs: Index) -> Mask:
    """Return which postures keep pairs of bodies at `_APART` m from each other (N,)."""
    frames, clear, ends = empty_frames(tree), np.ones(len(q), np.bool_), np.empty((3, 6))
    for k in range(len(q)):
        forward(q[k], tree, frames)
        place(world, frames)
        for a, b in pairs:
            if self_clearance(world, a, b, _APART, ends) < _APART:
                clear[k] = False
                break
    return clear


def _least_facing(tree: RobotTree, world: World) -> float:
    """Return the least cosine of a tip's axis to a face's inward normal at which the tip meets the face, not its link.

    Where tips bulge towards their pads, or are thin, the link behind them gets in the way of what they could press.
    """
    turns, least = np.linspace(0.0, 0.5 * np.pi, 91), _LEAST
    for reach in _behind(turns, tree, world):
        meets = reach > tree.tip_radius - _DEPTH + _BESIDE
        least = max(least, float(np.cos(turns[~meets].max(initial=0.0))))
    # What is behind the pad of a jaw may end before the face.
    return min(least, _SQUARE) if tree.torsion else least


@njit
def _behind(turns: Array, tree: RobotTree, world: World) -> Array:
    """Return how far (g, N), m, links reach beyond their tips' centres along ways turned from the tip's axis (N,) rad.

    A way points down on the table, and the tip's centre lies in its plane.
    """
    frames, ends, out = empty_frames(tree), np.empty((3, 6)), np.empty((len(tree.tip_body), len(turns)))
    for i, b in enumerate(tree.tip_body):
        for k, turn in enumerate(turns):
            s, c = np.sin(turn), np.cos(turn)
            frames.R[b] = np.array([[c, 0.0, -s], [0.0, -1.0, 0.0], [-s, 0.0, -c]])
            frames.p[b] = -frames.R[b] @ tree.tip_offset[i]
            place_body(world, frames, b)
            out[i, k] = -table_clearance(world, b, 1.0, True, ends)
    return out


@njit
def _tip_frames(q: Array, tree: RobotTree) -> tuple[Array, Array, Array]:
    """Return centres, axes and pads of the tips in postures (N, n), see `Tips`."""
    frames, shape = empty_frames(tree), (len(q), len(tree.tip_body), 3)
    tips, axes, pads = np.empty(shape), np.empty(shape), np.empty(shape)
    R, p = frames.R, frames.p
    forward(q[0], tree, frames)
    palm = R[tree.palm] @ tree.palm_rotation  # the arm stands still
    origin = p[tree.palm] + R[tree.palm] @ tree.palm_offset
    for k in range(len(q)):
        forward_part(q[k], tree, frames, tree.palm + 1, len(R))
        away = tip_positions(tree, frames) - origin
        for i in range(tips.shape[1]):
            tip = R[tree.tip_body[i]]
            for r in range(3):
                x, y, z = palm[0, r], palm[1, r], palm[2, r]
                tips[k, i, r] = x * away[i, 0] + y * away[i, 1] + z * away[i, 2]
                axes[k, i, r] = x * tip[0, 2] + y * tip[1, 2] + z * tip[2, 2]
                pads[k, i, r] = x * tip[0, 0] + y * tip[1, 0] + z * tip[2, 0]
    return tips, axes, pads
