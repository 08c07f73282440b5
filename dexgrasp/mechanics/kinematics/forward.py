"""Forward kinematics and Jacobians, compiled."""

from typing import NamedTuple

import numpy as np

from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import leaf, njit


class Frames(NamedTuple):
    """Frames of all bodies, in the world frame."""

    R: Array  # (nb, 3, 3)
    p: Array  # (nb, 3) m


@njit
def empty_frames(tree: RobotTree) -> Frames:
    """Return room for the frames of a robot."""
    bodies = tree.parent.shape[0]
    return Frames(np.empty((bodies, 3, 3)), np.empty((bodies, 3)))


@leaf
def forward(q: Array, tree: RobotTree, frames: Frames) -> None:
    """Write the body frames for joint positions `q` (n,) rad into `frames`."""
    forward_part(q, tree, frames, 0, tree.parent.shape[0])


@leaf
def forward_part(q: Array, tree: RobotTree, frames: Frames, first: int, end: int) -> None:
    """Write the frames of bodies `first` to `end` only; those before them are there. The hand follows the palm."""
    R, p = frames.R, frames.p
    for b in range(first, end):
        a, j = tree.parent[b], tree.joint[b]
        L = tree.rotation[b]
        if a < 0:
            for r in range(3):
                p[b, r] = tree.offset[b, r]
                for c in range(3):
                    R[b, r, c] = L[r, c]
        else:
            to_world(R[a], p[a], tree.offset[b], p[b])
            for r in range(3):
                for c in range(3):
                    R[b, r, c] = R[a, r, 0] * L[0, c] + R[a, r, 1] * L[1, c] + R[a, r, 2] * L[2, c]
        if j >= 0:
            place = tree.gear[b, 0] * q[j] + tree.gear[b, 1]
            if tree.slides[b]:
                x, y, z = place * tree.axis[b, 0], place * tree.axis[b, 1], place * tree.axis[b, 2]
                for r in range(3):
                    p[b, r] = p[b, r] + R[b, r, 0] * x + R[b, r, 1] * y + R[b, r, 2] * z
            else:
                _turn(R[b], tree.axis[b], place)


@leaf
def _turn(R: Array, axis: Array, angle: float) -> None:
    """R <- R Rot(axis, angle), in place (Rodrigues)."""
    s, c = np.sin(angle), np.cos(angle)
    x, y, z = axis[0], axis[1], axis[2]
    t = 1.0 - c
    a00, a01, a02 = c + t * x * x, t * x * y - s * z, t * x * z + s * y
    a10, a11, a12 = t * x * y + s * z, c + t * y * y, t * y * z - s * x
    a20, a21, a22 = t * x * z - s * y, t * y * z + s * x, c + t * z * z
    for r in range(3):
        u, v, w = R[r, 0], R[r, 1], R[r, 2]
        R[r, 0] = u * a00 + v * a10 + w * a20
        R[r, 1] = u * a01 + v * a11 + w * a21
        R[r, 2] = u * a02 + v * a12 + w * a22


@leaf
def to_world(R: Array, p: Array, local: Array, out: Array) -> None:
    """Write R local + p, (3,)."""
    for r in range(3):
        out[r] = p[r] + R[r, 0] * local[0] + R[r, 1] * local[1] + R[r, 2] * local[2]


@leaf
def _motion(b: int, point: Array, tree: RobotTree, frames: Frames) -> tuple[float, float, float]:
    """Return how a point (3,) moves with the joint of body `b`, m/rad: the joint's axis x the way to the point.

    With a slide it moves along the axis.
    """
    R, p, axis = frames.R, frames.p, tree.axis
    ax = R[b, 0, 0] * axis[b, 0] + R[b, 0, 1] * axis[b, 1] + R[b, 0, 2] * axis[b, 2]
    ay = R[b, 1, 0] * axis[b, 0] + R[b, 1, 1] * axis[b, 1] + R[b, 1, 2] * axis[b, 2]
    az = R[b, 2, 0] * axis[b, 0] + R[b, 2, 1] * axis[b, 1] + R[b, 2, 2] * axis[b, 2]
    gear = tree.gear[b, 2]
    if tree.slides[b]:
        return gear * ax, gear * ay, gear * az
    dx, dy, dz = point[0] - p[b, 0], point[1] - p[b, 1], point[2] - p[b, 2]
    return gear * (ay * dz - az * dy), gear * (az * dx - ax * dz), gear * (ax * dy - ay * dx)


@leaf
def add_row(
    row: Array, body: int, point: Array, direction: Array, sign: float, tree: RobotTree, frames: Frames
) -> None:
    """Add sign * direction . (Jacobian of a point of a body) to `row` (n,).

    The point and the direction (3,) are in the world frame.
    """
    b = body
    while b >= 0:
        j = tree.joint[b]
        if j >= 0:
            x, y, z = _motion(b, point, tree, frames)
            row[j] += sign * (direction[0] * x + direction[1] * y + direction[2] * z)
        b = tree.parent[b]


@leaf
def add_turn_row(
    row: Array, body: int, direction: Array, sign: float, tree: RobotTree, frames: Frames
) -> None:
    """Add sign * direction . (angular Jacobian of a body) to `row` (n,)."""
    R, b = frames.R, body
    while b >= 0:
        j = tree.joint[b]
        if j >= 0 and not tree.slides[b]:
            for r in range(3):
                a = R[b, r, 0] * tree.axis[b, 0] + R[b, r, 1] * tree.axis[b, 1] + R[b, r, 2] * tree.axis[b, 2]
                row[j] += sign * tree.gear[b, 2] * direction[r] * a
        b = tree.parent[b]


@njit
def tip_positions(tree: RobotTree, frames: Frames) -> Array:
    """Return the tip sphere centres (g, 3) m of the grasping fingers."""
    tips = np.empty((tree.tip_body.shape[0], 3))
    for i in range(tips.shape[0]):
        b = tree.tip_body[i]
        to_world(frames.R[b], frames.p[b], tree.tip_offset[i], tips[i])
    return tips


@njit
def tip_jacobian(tree: RobotTree, frames: Frames, tips: Array) -> Array:
    """Return the linear Jacobians (g, 3, n) of points (g, 3) m of the tips: finger, coordinate, joint."""
    J = np.empty((tree.tip_body.shape[0], 3, tree.lower.shape[0]))
    contact_jacobian(tree, frames, tips, tips, -1, J)
    return J


@leaf
def contact_jacobian(
    tree: RobotTree, frames: Frames, points: Array, normals: Array, top: int, J: Array
) -> None:
    """Write the Jacobians (g, c, n) of contacts; the fourth part is their turn about the normals by `torsion`, m/rad.

    Args:
        tree: the robot.
        frames: of its bodies.
        points: (g, 3) m, of the tips.
        normals: (g, 3) out of the object, for the fourth part.
        top: body below which joints count, of the other parts: -1 all, `tree.palm` the hand's.
        J: (g, 3 or 4, n), written.
    """
    J[:] = 0.0
    for i in range(J.shape[0]):
        add_columns(J[i], tree.tip_body[i], top, points[i], tree, frames)
        if J.shape[1] == 4:
            add_turn_row(J[i, 3], tree.tip_body[i], normals[i], tree.torsion, tree, frames)


@leaf
def follow(q: Array, tree: RobotTree) -> None:
    """Put the joints of `q` (n,) that follow others where those have them, in place.

    Those of a tendon stand on their stops then, and the last one has what the others lose: servos are told the same.
    """
    for j in range(q.shape[0]):
        k = tree.follows[j]
        if k >= 0 and tree.ratio[j, 2] > 0.0:
            q[k] += tree.ratio[j, 0] * (q[j] - tree.ratio[j, 1])
            q[j] = tree.ratio[j, 1]
        elif k >= 0:
            q[j] = tree.ratio[j, 0] * q[k] + tree.ratio[j, 1]


@leaf
def add_columns(J: Array, body: int, top: int, point: Array, tree: RobotTree, frames: Frames) -> None:
    """Add the linear Jacobian of a point (3,) of a body to `J` (3 or more, n), of the joints below body `top`."""
    b = body
    while b > top:
        j = tree.joint[b]
        if j >= 0:
            x, y, z = _motion(b, point, tree, frames)
            J[0, j] += x
            J[1, j] += y
            J[2, j] += z
        b = tree.parent[b]


def body_frames(q: Array, tree: RobotTree) -> Frames:
    """Return the frames of all bodies at `q` (n,) rad."""
    # `empty_frames` would be one more to load.
    frames = Frames(np.empty_like(tree.rotation), np.empty_like(tree.offset))
    forward(np.ascontiguousarray(q, dtype=float), tree, frames)
    return frames


def hand_contact_jacobian(q: Array, points: Array, normals: Array, tree: RobotTree) -> Array:
    """Return `contact_jacobian` (g, c, n - arm) at `q` (n,) rad, by the hand's joints."""
    J = np.zeros((len(points), len(tree.model.parts), len(q)))
    contact_jacobian(tree, body_frames(q, tree), points, normals, tree.palm, J)
    return J[:, :, tree.arm :]


def stop_torques(q: Array, points: Array, normals: Array, forces: Array, tree: RobotTree) -> Array:
    """Return the torques (k,) Nm that press the joints which stand onto their stops: what their tendons leave over.

    Args:
        q: (n,) rad, a grasp.
        points, normals, forces: of its contacts, (g, 3) m, (g, 3), (g, c) N on the object.
        tree: of the robot.
    """
    gear = tree.gear.copy()
    gear[:, 2] = gear[:, 0]
    J = hand_contact_jacobian(q, points, normals, tree._replace(gear=gear))
    torque = np.append(np.zeros(tree.arm), np.einsum("frj,fr->j", J, forces))
    return (torque - tree.ratio[:, 0] * torque[tree.follows])[tree.stands]


def fingertips(q: Array, tree: RobotTree) -> Array:
    """Return the tip sphere centres (g, 3) m of the grasping fingers at `q` (n,) rad."""
    return tip_positions(tree, body_frames(q, tree))
