"""Policy cloned from clouds, in numpy: observes once, and executes the likeliest grasp that the arm can reach.

The network scores grips all around the object and predicts the grasps along each. Inverse kinematics moves the tips to
the prediction; approach, closing until contact (felt by joint errors) and lift are those of the planner's grasps.
"""

from collections.abc import Iterator
from itertools import islice

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.geometry.hull import standing_hull
from dexgrasp.grasp.certificate import Certificate
from dexgrasp.grasp.grasp import Grasp, GraspMotion
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.learning.imitation.cloud_features import NUMBERS, ObservedCloud, grip_features, observed_cloud
from dexgrasp.learning.imitation.demonstrated_grasp import (
    DemonstratedGrasp,
    grasp_from_row,
    outward_normals,
)
from dexgrasp.learning.imitation.policy import Mlp, Policy, Scaling
from dexgrasp.mechanics.kinematics.palm_ik import palm_postures
from dexgrasp.mechanics.kinematics.tip_ik import solve_tips
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.motion.carrying import PickUp
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.move_until_contact import TIP_DEPTH, lag_of, pressing_torques
from dexgrasp.motion.script import make_script
from dexgrasp.runs.weights import Weights, relu
from dexgrasp_env.arrays import Array, Fields, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell

_AZIMUTHS = np.linspace(0.0, 2 * np.pi, 36, endpoint=False)


class CloudGraspPolicy(Policy):
    """Policy that chooses one grasp from a cloud."""

    kind = "grasper"

    def _read(self, about: Fields, arrays: Weights) -> bool:
        self._modes = int(about["modes"])
        self._scaling = Scaling(arrays["mean"], arrays["scale"])
        self._rows = Scaling(arrays["row_mean"], arrays["row_scale"])
        self._encoder, self._trunk = Mlp(arrays, "encoder", relu), Mlp(arrays, "trunk", relu)
        self.row = len(self._rows.mean)
        return (
            self._encoder.inputs == 6
            and len(self._scaling.mean) == NUMBERS
            and self._trunk.inputs == self._encoder.outputs + NUMBERS
            and self._trunk.outputs == self._modes * (1 + self.row)
        )

    def begin(self, first: Observation, cell: Cell) -> "CloudGraspRun":
        """Choose a grasp and start an episode in a cell.

        Raises:
            InputError: without a cloud, or where no grasp can be executed.
        """
        return CloudGraspRun(self, first, cell)

    def predict(self, cloud: ObservedCloud, azimuths: Array) -> tuple[Array, Array]:
        """Return logits (m, modes) and rows (m, modes, R) of grasps along grips of azimuths (m,) rad."""
        points, numbers = grip_features(cloud, azimuths)
        seen = np.concatenate([relu(self._encoder(points)).max(axis=1), self._scaling(numbers)], axis=1)
        out = self._trunk(seen).reshape(len(azimuths), self._modes, 1 + self.row).astype(float)
        return out[..., 0], self._rows.mean + self._rows.scale * out[..., 1:]

    def grasps(self, cloud: ObservedCloud, tree: RobotTree) -> Iterator[DemonstratedGrasp]:
        """Yield grasps of an object, the likeliest first."""
        logits, rows = self.predict(cloud, _AZIMUTHS)
        for flat in np.argsort(-logits, axis=None):
            k, mode = divmod(int(flat), self._modes)
            yield grasp_from_row(rows[k, mode], cloud.middle, float(_AZIMUTHS[k]), tree)


class CloudGraspRun:
    """Policy cloned from clouds in one episode."""

    def __init__(self, grasper: CloudGraspPolicy, first: Observation, cell: Cell) -> None:
        """Choose a grasp from the first observation.

        Raises:
            InputError: as `CloudGraspPolicy.begin`.
        """
        tree = robot_tree(cell)
        cloud, start = observed_cloud(first), np.array(first["joint_targets"], dtype=float)
        self._motion = PickUp(*_first(grasper.grasps(cloud, tree), cloud, start, cell))

    def action(self, observation: Observation) -> Single:
        """Return the next action, of `joint_position`."""
        return self._motion.action(observation["joint_positions"])


def _first(
    grasps: Iterator[DemonstratedGrasp], cloud: ObservedCloud, start: Array, cell: Cell
) -> tuple[ActionScript, Grasp]:
    """Return the script of the first grasp that the arm can execute, and that grasp.

    Raises:
        InputError: with the reason why none can be executed.
    """
    obstacle, reason = standing_hull(cloud.points), "out_of_reach"
    for wanted in islice(grasps, 24):
        grasp = _posed(wanted, start, cell)
        if grasp is None:
            continue
        try:
            return make_script(start, grasp.motion, obstacle, cell, margin=0.0), grasp
        except NoPath as blocked:
            reason = blocked.reason
    raise InputError(reason)


def _posed(wanted: DemonstratedGrasp, start: Array, cell: Cell) -> Grasp | None:
    """Return a grasp in joints of the robot; None if inverse kinematics fails."""
    tree = robot_tree(cell)
    lower, upper, hand = tree.lower, tree.upper, slice(tree.arm, None)
    q = start.copy()
    q[hand] = np.clip(wanted.closed, lower[hand], upper[hand])
    if next(palm_postures(q, wanted.rotation, wanted.palm, tree), None) is None:
        return None
    if solve_tips(q, wanted.tips, tree, 60, 5e-4) > 0.006:  # m that tips may be off
        return None
    pregrasp = np.concatenate([q[: tree.arm], np.clip(wanted.opened, lower[hand], upper[hand])])
    normals = outward_normals(wanted.forces)
    squeeze = np.clip(q + lag_of(pressing_torques(q, normals, wanted.forces, tree), tree), lower, upper)
    contacts = wanted.tips - TIP_DEPTH * tree.tip_radius * normals
    certificate = Certificate.unclaimed(len(contacts))
    return Grasp(q, contacts, normals, wanted.forces, certificate, GraspMotion(pregrasp, q, squeeze), cell)
