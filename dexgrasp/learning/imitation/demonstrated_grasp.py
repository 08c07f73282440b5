"""Grasp of a demonstration, and its encoding as a row of numbers in the frame of its grip."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dexgrasp.data.demonstrations.rollout import Demonstration, intended
from dexgrasp.mechanics.kinematics.forward import fingertips, hand_contact_jacobian
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.motion.move_until_contact import TIP_DEPTH
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import about_z
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.tasks.features import METRES, entry

_NEWTONS = 10.0  # N, the network's unit of force


class DemonstratedGrasp(NamedTuple):
    """Grasp with g contacts by a hand of h joints; world frame.

    Attributes:
        tips: (g, 3) m, centres of the fingertips in contact, the opposing one first.
        palm: (3,) m, position.
        rotation: (3, 3) of the palm.
        closed: (h,) rad, hand joints in the grasp.
        opened: (h,) rad, hand joints before closing.
        forces: (g, 3) N on the object.
    """

    tips: Array
    palm: Array
    rotation: Array
    closed: Array
    opened: Array
    forces: Array

    @property
    def azimuth(self) -> float:
        """Azimuth of the level line from the opposing tip to the mean of the others, rad."""
        x, y, _ = self.tips[1:].mean(axis=0) - self.tips[0]
        return float(np.arctan2(y, x))


def demonstrated_grasp(episode: Demonstration, noise: float, cell: Cell) -> DemonstratedGrasp | None:
    """Return the grasp of a demonstration in which the arm stands still once while the hand closes; else None."""
    tree, meant = robot_tree(cell), intended(episode, noise, cell.robot)
    waits = _waits(meant[: episode.about["solved"], : tree.arm])
    if len(waits) != 1:
        return None
    opened, closed = waits[0]
    q = entry(episode.observations, "joint_positions")[closed]
    rotation, palm = palm_frame(q, tree)
    hand = slice(tree.arm, None)
    torques = (meant[closed] - q)[hand] * tree.stiffness
    return DemonstratedGrasp(
        fingertips(q, tree), palm, rotation, q[hand], meant[opened, hand], _forces(q, torques, tree)
    )


def _waits(arm: Array) -> list[tuple[int, int]]:
    """Return the first and last steps of the intervals in which the arm (T, a) rad stands still before it goes on."""
    moves = np.flatnonzero(np.abs(np.diff(arm, axis=0)).max(axis=1) > 1e-6)  # rad
    return [(int(a) + 1, int(b)) for a, b in pairwise(moves) if b - a > 15]


def _forces(q: Array, torques: Array, tree: RobotTree) -> Array:
    """Return the forces (g, 3) N on the object that explain torques (h,) Nm of the hand, by least squares."""
    tips = points = fingertips(q, tree)
    normals, forces = np.tile([0.0, 0.0, 1.0], (len(tips), 1)), np.zeros_like(tips)
    for _ in range(3):  # the points depend on the forces by a millimetre
        J = hand_contact_jacobian(q, points, normals, tree)[:, :3]
        forces = np.stack([np.linalg.lstsq(rows.T, torques, rcond=None)[0] for rows in J])
        normals = outward_normals(forces)
        points = tips - TIP_DEPTH * tree.tip_radius * normals
    return forces


def outward_normals(forces: Array) -> Array:
    """Return unit directions (g, 3) out of the object, opposite to forces (g, 3) on it."""
    return -forces / np.maximum(np.linalg.norm(forces, axis=1, keepdims=True), 1e-6)


def grasp_to_row(grasp: DemonstratedGrasp, middle: Array) -> Array:
    """Encode a grasp as a row (R,) in the frame of its grip about the middle (3,) m of the cloud."""
    turn = about_z(-grasp.azimuth)
    parts = [
        METRES * (grasp.tips - middle) @ turn.T, METRES * turn @ (grasp.palm - middle), (turn @ grasp.rotation)[:, :2],
        grasp.closed, grasp.opened, grasp.forces @ turn.T / _NEWTONS,
    ]  # fmt: skip
    return np.concatenate([part.ravel() for part in parts])


def sizes(tree: RobotTree) -> tuple[int, ...]:
    """Return the lengths of the parts of a row: tips, palm, its rotation, hand closed and opened, forces."""
    contacts, joints = 3 * len(tree.fingers), len(tree.stiffness)
    return contacts, 3, 6, joints, joints, contacts


def grasp_from_row(row: Array, middle: Array, azimuth: float, tree: RobotTree) -> DemonstratedGrasp:
    """Decode a row (R,) to the grasp along a grip of an azimuth, rad."""
    tips, palm, axes, closed, opened, forces = np.split(row, np.cumsum(sizes(tree))[:-1])
    back = about_z(-azimuth).T
    x, y = axes.reshape(3, 2).T
    x = x / np.linalg.norm(x)
    y = y - (x @ y) * x
    y = y / np.linalg.norm(y)
    return DemonstratedGrasp(
        middle + tips.reshape(-1, 3) @ back.T / METRES,
        middle + back @ palm / METRES,
        back @ np.stack([x, y, np.cross(x, y)], axis=1),
        closed,
        opened,
        _NEWTONS * forces.reshape(-1, 3) @ back.T,
    )
