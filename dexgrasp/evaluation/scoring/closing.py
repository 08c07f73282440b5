"""Pregrasp and squeeze for files that give one configuration and its contacts.

The squeeze applies the forces of Eq. 4, in friction cones and with the least residual wrench, as FRoGGeR's own
controller does; they are scaled to 4 N at the contact of the largest normal force, or to 0.5 Nm at the joint of the
largest torque. The pregrasp moves each contact back along its normal.
"""

from dataclasses import replace

import mujoco
import numpy as np

from dexgrasp.evaluation.scoring.hand import HandModel, HandStage
from dexgrasp.mechanics.wrench import solve_wrench_qp
from dexgrasp_env.arrays import Array, unit

SERVO_KP = 10.0  # Nm/rad of the servos that the squeeze is made for


def close_around(
    hand: HandModel, grasp: HandStage, points: Array, inward: Array
) -> tuple[HandStage, HandStage]:
    """Return pregrasp and squeeze of a grasp by its contacts.

    Args:
        hand: the hand.
        grasp: its configuration.
        points: (k, 3) m, contacts in the world.
        inward: (k, 3) normals into the object.
    """
    inward = unit(inward)
    J = contact_jacobians(hand, grasp, points)
    # pyramids of 0.35 lie within the cones of 0.5
    forces = solve_wrench_qp(points, -inward, 0.35).forces
    torques = 4.0 / (forces * inward).sum(1).max() * forces.ravel() @ J
    # 0.5 Nm of the busiest joint: hands of this size bear 0.7.
    press = torques * min(1.0, 0.5 / max(float(np.abs(torques).max()), 1e-9)) / SERVO_KP
    # 15 mm back, by least squares damped with 0.02 m/rad.
    back = J.T @ np.linalg.solve(J @ J.T + 0.02**2 * np.eye(len(J)), (-0.015 * inward).ravel())
    model = hand.model
    low, high = np.where(model.jnt_limited[:, None], model.jnt_range, [-np.inf, np.inf]).T
    opened = np.clip(grasp.joints + back, low, high)
    return replace(grasp, joints=opened), replace(grasp, joints=grasp.joints + press)


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
