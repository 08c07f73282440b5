"""A grasp before the judge: what its file says, the cell it is for, and what it does there."""

from functools import cached_property

import numpy as np

from dexgrasp.grasp.record import GraspRecord
from dexgrasp.grasp.verify.cones import slides, wrench_map
from dexgrasp.grasp.verify.scene import Scene
from dexgrasp_env.arrays import Array

GRAVITY = 9.81  # m/s^2


class Case:
    """One grasp in one cell.

    Attributes:
        record: of the file.
        limits: thresholds of the record.
        cell, robot: in which the record was read.
        scene: robot, object and table.
        touch: where the tips are.
    """

    def __init__(self, record: GraspRecord) -> None:
        """Set the scene."""
        self.record, self.limits = record, record.thresholds
        self.cell = record.here
        self.robot = self.cell.robot
        self.scene = Scene(self.cell, record.parts, record.fingers, record.neighbour_parts)
        self.touch = self.scene.touch(record.q)

    @cached_property
    def top(self) -> float:
        """Height of the object's highest point, m."""
        return max(float(part[:, 2].max()) for part in self.record.parts)

    @cached_property
    def idle(self) -> list[int]:
        """The joints of the fingers that make no contact."""
        return [
            joint
            for finger, own in self.robot.columns.items()
            if finger not in self.record.fingers
            for joint in range(own.start, own.stop)
        ]

    @cached_property
    def servos(self) -> tuple[Array, Array]:
        """Torque limits and stiffness of the hand's joints, with what those that follow them add."""
        hand = self.robot.hand_columns
        torque, stiffness = self.robot.torque[hand], self.robot.stiffness[hand]
        C = np.abs(self.robot.drive[0][hand, hand])
        follows = ~C.any(0)
        return np.where(follows, torque, C.T @ torque), np.where(follows, stiffness, (C * C).T @ stiffness)

    @cached_property
    def hold(self) -> "ForceBalance":
        """Effect of the planned forces."""
        return ForceBalance(self)


class ForceBalance:
    """Effect of the planned forces about the centre of mass, in weights: balance, friction and torque that they use.

    `compliance` (c N, c N) m/N is how contacts give way to forces where set-points stand still.
    """

    def __init__(self, case: Case) -> None:
        """Compute it."""
        self.forces, self.normals, self.mu = case.record.forces, case.touch.normals, case.limits.friction_hold
        self.weight = GRAVITY * case.record.certificate.mass
        self.G = wrench_map(case.touch.points, case.record.centre, self.normals, case.robot.hand.torsion)
        self.wrench = self.G @ self.forces.ravel() / self.weight
        self.left = self.wrench - np.eye(6)[2]
        self.press, sliding = slides(self.forces, self.normals)
        self.friction_use = (sliding / np.maximum(self.mu * self.press, 1e-9)).max()
        most, stiffness = case.servos
        self.torques = case.touch.jacobians.transpose(2, 0, 1).reshape(len(most), -1) / most[:, None]
        bend = self.torques * most[:, None]
        # m/N that a contact gives way besides its joints
        self.compliance = bend.T @ (bend / stiffness[:, None]) + 1e-6 * np.eye(self.forces.size)
        self.torque_use = np.abs(self.torques @ self.forces.ravel()).max()
