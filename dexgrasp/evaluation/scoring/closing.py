"""Pregrasp and squeeze for files that give one configuration and its contacts.

The squeeze applies forces in balance: each contact at least 1 N along its normal, all in their friction cones, with
the least residual wrench (as FRoGGeR's own controller does); they are scaled to `PRESS` at the contact of the largest
normal force, or to 0.5 Nm at the joint of the largest torque. The pregrasp moves each contact back along its normal.
"""

from dataclasses import replace

import mujoco
import numpy as np
from scipy.optimize import nnls

from dexgrasp.evaluation.scoring.hand import HandModel, HandStage
from dexgrasp.mechanics.cones import cone_edges
from dexgrasp_env.arrays import Array, unit

PRESS = 4.0  # N, the largest normal force
SERVO_KP = 10.0  # Nm/rad of the servos that the squeeze is made for


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
    inward = unit(inward)
    J = contact_jacobians(hand, grasp, points)
    torques = balanced_forces(points, inward, centre).ravel() @ J
    # 0.5 Nm of the busiest joint: hands of this size bear 0.7.
    press = torques * min(1.0, 0.5 / max(float(np.abs(torques).max()), 1e-9)) / SERVO_KP
    # 15 mm back, by least squares damped with 0.02 m/rad.
    back = J.T @ np.linalg.solve(J @ J.T + 0.02**2 * np.eye(len(J)), (-0.015 * inward).ravel())
    model = hand.model
    low, high = np.where(model.jnt_limited[:, None], model.jnt_range, [-np.inf, np.inf]).T
    opened = np.clip(grasp.joints + back, low, high)
    return replace(grasp, joints=opened), replace(grasp, joints=grasp.joints + press)


def balanced_forces(points: Array, inward: Array, centre: Array) -> Array:
    """Return forces (k, 3) N on the object in balance; the largest normal force is `PRESS`.

    Args:
        points: (k, 3) m, contacts.
        inward: (k, 3) unit normals into the object.
        centre: (3,) m, which torques are taken about; they are divided by the points' rms distance from it.
    """
    count, arms = len(points), points - centre
    length = max(float(np.sqrt((arms**2).sum(1).mean())), 1e-6)
    sides = 8  # of a pyramid in the place of the cone of friction 0.5
    edges = cone_edges(-inward, 0.5, sides)  # (k, e, 3)
    wrench = np.concatenate([edges, np.cross(arms[:, None], edges) / length], axis=-1)  # (k, e, 6)
    base = np.concatenate([inward, np.cross(arms, inward) / length], axis=-1).sum(0)
    # The forces themselves weigh little against the wrench.
    matrix = np.concatenate([wrench.reshape(-1, 6).T, 1e-4 * np.eye(count * sides)])
    weights, _ = nnls(matrix, np.concatenate([-base, np.zeros(count * sides)]))
    forces = inward + (weights.reshape(count, sides, 1) * edges).sum(1)
    return forces * (PRESS / (forces * inward).sum(1).max())


def contact_jacobians(hand: HandModel, grasp: HandStage, points: Array) -> Array:
    """Return (3 k, n): velocities in the world of points (k, 3) on the links nearest to them, per joint."""
    model, T = hand.model, grasp.T_world_hand
    data = mujoco.MjData(model)
    data.qpos[:] = grasp.joints
    mujoco.mj_forward(model, data)
    found = np.zeros((len(points), 3, model.nv))
    for jacobian, point in zip(found, (points - T[:3, 3]) @ T[:3, :3], strict=True):
        body = int(model.geom_bodyid[np.linalg.norm(data.geom_xpos - point, axis=1).argmin()])
        mujoco.mj_jac(model, data, jacobian, None, point, body)
    return (T[:3, :3] @ found).reshape(-1, model.nv)
