"""How to open and to squeeze where a file gives one configuration and its contacts.

The squeeze presses with forces in balance: each contact at least 1 N along its normal, all in their friction cones,
with the least wrench left over (the law of FRoGGeR's own controller); then as hard as `PRESS` at the firmest contact or
`TORQUE` at the busiest joint. The pregrasp draws each contact back along its normal.
"""

from dataclasses import replace

import mujoco
import numpy as np
from scipy.optimize import nnls

from dexgrasp.scoring.candidate import HandStage
from dexgrasp.scoring.hand import HandModel
from dexgrasp_env.arrays import Array

PRESS = 4.0  # N, normal, of the firmest contact
TORQUE = 0.5  # Nm, of the busiest joint: hands of this size bear 0.7
RETREAT = 0.015  # m
SERVO_KP = 10.0  # Nm/rad that the squeeze is given for
_FRICTION, _EDGES = 0.5, 8
_TINY = 1e-4  # weight of the forces themselves, against the wrench
_DAMPING = 0.02  # m/rad, of the least squares


def close_around(
    hand: HandModel, grasp: HandStage, points: Array, inward: Array, centre: Array
) -> tuple[HandStage, HandStage]:
    """Return pregrasp and squeeze of a grasp by its contacts.

    Args:
        hand: the hand.
        grasp: its configuration.
        points: (k, 3) m, contacts in the world.
        inward: (k, 3) normals into the object.
        centre: (3,) m, of the object's mass.
    """
    inward = inward / np.linalg.norm(inward, axis=1, keepdims=True)
    forces = balanced_forces(points, inward, centre)
    press = squeeze_offsets(hand, grasp.joints, grasp.T_world_hand, points, forces)
    opened_joints = opened(hand, grasp.joints, grasp.T_world_hand, points, inward)
    return replace(grasp, joints=opened_joints), replace(grasp, joints=grasp.joints + press)


def balanced_forces(points: Array, inward: Array, centre: Array) -> Array:
    """Return forces (k, 3) N on the object in balance; the firmest presses with `PRESS`, none draws.

    Contacts are at `points` (k, 3) m with unit normals `inward` (k, 3). Torques are taken about `centre` (3,), over
    the points' rms distance from it.
    """
    count, arms = len(points), points - centre
    length = max(float(np.sqrt((arms**2).sum(1).mean())), 1e-6)
    edges = np.stack([_cone_edges(n) for n in inward])  # (k, e, 3)
    wrench = np.concatenate([edges, np.cross(arms[:, None], edges) / length], axis=-1)  # (k, e, 6)
    base = np.concatenate([inward, np.cross(arms, inward) / length], axis=-1).sum(0)
    flat = edges.reshape(count, -1, 3)
    matrix = np.concatenate([wrench.reshape(-1, 6).T, _TINY * np.eye(count * _EDGES)])
    weights, _ = nnls(matrix, np.concatenate([-base, np.zeros(count * _EDGES)]))
    forces = inward + (weights.reshape(count, _EDGES, 1) * flat).sum(1)
    return forces * (PRESS / (forces * inward).sum(1).max())


def squeeze_offsets(
    hand: HandModel, joints: Array, T_world_hand: Array, points: Array, forces: Array
) -> Array:
    """Return joint offsets (n,) rad that press with `forces` (k, 3) N on the object, by servos of `SERVO_KP`."""
    jacobians = contact_jacobians(hand, joints, T_world_hand, points)
    torques = np.einsum("kin,ki->n", jacobians, forces)
    return torques * min(1.0, TORQUE / max(float(np.abs(torques).max()), 1e-9)) / SERVO_KP


def opened(hand: HandModel, joints: Array, T_world_hand: Array, points: Array, inward: Array) -> Array:
    """Return joints (n,) that draw each contact back by `RETREAT`, within the joints' ranges."""
    J = contact_jacobians(hand, joints, T_world_hand, points).reshape(-1, hand.model.nv)
    wanted = (-RETREAT * inward).ravel()
    step = J.T @ np.linalg.solve(J @ J.T + _DAMPING**2 * np.eye(len(J)), wanted)
    model, limited = hand.model, hand.model.jnt_limited.astype(bool)
    found = joints + step
    return np.where(limited, np.clip(found, model.jnt_range[:, 0], model.jnt_range[:, 1]), found)


def contact_jacobians(hand: HandModel, joints: Array, T_world_hand: Array, points: Array) -> Array:
    """Return (k, 3, n): velocities in the world of points on the links nearest to them, per joint."""
    model = hand.model
    data = mujoco.MjData(model)
    data.qpos[:] = joints
    mujoco.mj_forward(model, data)
    R = T_world_hand[:3, :3]
    local = (points - T_world_hand[:3, 3]) @ R
    found = np.zeros((len(points), 3, model.nv))
    for jacobian, point in zip(found, local, strict=True):
        body = int(model.geom_bodyid[np.linalg.norm(data.geom_xpos - point, axis=1).argmin()])
        mujoco.mj_jac(model, data, jacobian, None, point, body)
    return np.einsum("ij,kjn->kin", R, found)


def _cone_edges(normal: Array) -> Array:
    """Edges (e, 3) of the pyramid inside the friction cone about a unit normal."""
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    angles = np.linspace(0.0, 2.0 * np.pi, _EDGES, endpoint=False)
    return normal + _FRICTION * (np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second)
