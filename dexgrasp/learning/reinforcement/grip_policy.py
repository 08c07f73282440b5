"""Cloned policy whose grip a network corrects once an episode, in numpy."""

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.data.demonstrations.convert import to_action
from dexgrasp.learning.imitation.bc_policy import BcPolicy, BcRun
from dexgrasp.learning.imitation.policy import Mlp, Policy
from dexgrasp.mechanics.kinematics.damped import damped_step
from dexgrasp.mechanics.kinematics.forward import empty_frames, forward
from dexgrasp.mechanics.kinematics.palm_ik import TURN_SCALE, palm_jacobian
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.runs.weights import Weights, below
from dexgrasp_env.arrays import Array, Fields, Single
from dexgrasp_env.compiled import njit
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.tasks.control import max_step
from dexgrasp_env.tasks.features import entry, features, initial_scene
from dexgrasp_env.tasks.grasp_space import joint_changes

_PALM = {"deeper": (0, 0.03), "over": (2, 0.03), "tilted": (3, 0.2)}
"""Correction -> axis of the palm (0 to 2 translation, 3 to 5 rotation), and its m or rad at 1."""
_FINGERS = {
    "curled": {"index": (0.0, 0.2, 0.4, 0.3), "middle": (0.0, 0.2, 0.4, 0.3)},
    "thumb": {"thumb": (0.0, 0.4, 0.0, 0.0)},
}
"""Synergy -> rad of each joint at 1."""
GRIP_SIZE = len(_PALM) + len(_FINGERS)
"""Length of a correction, whose numbers are from -1 to 1."""
_RAMP = 30  # control steps until it is complete, well before the hand closes
_DAMPING = 1e-4  # of the least-squares step from palm to arm


class GripPolicy(Policy):
    """Cloned policy with a correction of its grip: palm and fingers are shifted once, from the first observation.

    A saturated servo squeezes no harder, so corrections of single actions gain little. Resistance to pushes depends on
    where and in which posture the hand grips: a few numbers an episode, which a thousand episodes suffice to learn.
    They are added to the set-points of the cloned policy, which does not see them.
    """

    kind = "grip"

    def _read(self, about: Fields, arrays: Weights) -> bool:
        self.clone = BcPolicy(about["base"], below(arrays, "base."))
        self._actor = Mlp(arrays, "actor", np.tanh)
        sized = self._actor.inputs == len(self.clone.scaling.mean) and self._actor.outputs == GRIP_SIZE
        return sized and self.env == self.clone.env

    def begin(self, first: Observation, cell: Cell) -> "GripRun":
        """Compute the correction and start an episode in a cell."""
        return GripRun(self.clone, first, self.correction(first_features(self.clone, first)), cell)

    def correction(self, encoded: Single) -> Array:
        """Return the correction (GRIP_SIZE,) for `first_features`."""
        return np.clip(self._actor(encoded), -1.0, 1.0).astype(float)


class GripRun:
    """Corrected policy in one episode."""

    def __init__(self, clone: BcPolicy, first: Observation, correction: Array, cell: Cell) -> None:
        """Start an episode.

        Args:
            clone: policy that is corrected.
            first: observation.
            correction: (GRIP_SIZE,) in [-1, 1].
            cell: of the robot.
        """
        self._robot, self._tree = cell.robot, robot_tree(cell)
        self._run, self._step = BcRun(clone, first, cell), 0
        self._own = np.array(first["joint_targets"], dtype=float)  # the clone's set-points, not corrected
        axes, sizes = zip(*_PALM.values(), strict=True)
        self._palm = np.zeros(6)
        self._palm[list(axes)] = correction[: len(_PALM)] * sizes
        self._fingers = correction[len(_PALM) :] @ joint_changes(cell.robot, _FINGERS)

    def action(self, observation: Observation) -> Single:
        """Return the next action."""
        wanted = self._run.set_points({**observation, "joint_targets": self._own})
        robot, most = self._robot, max_step(self._robot)
        self._own = np.clip(self._own + np.clip(wanted - self._own, -most, most), robot.lower, robot.upper)
        self._step += 1
        share = min(self._step / _RAMP, 1.0)
        corrected = self._own + share * self._fingers
        corrected[robot.arm_columns] += arm_step(self._own, share * self._palm, self._tree)
        return to_action("joint_delta", entry(observation, "joint_targets"), corrected, self._tree)


def first_features(clone: BcPolicy, first: Observation) -> Single:
    """Return the network's input: features (F,) of the first observation, normalised as for the cloned policy."""
    return clone.scaling(features(initial_scene(first), first, 0))


@njit
def arm_step(q: Array, move: Array, tree: RobotTree) -> Array:
    """Return the change (a,) rad of the arm that moves the palm by `move`: one step of damped least squares.

    Args:
        q: (n,) rad.
        move: (6,) m and rad, small, in the axes of the palm.
        tree: the robot.
    """
    frames, J, e = empty_frames(tree), np.empty((6, tree.arm)), np.empty(6)
    forward(q, tree, frames)
    palm_jacobian(tree, frames, J)
    R = frames.R[tree.palm] @ tree.palm_rotation
    e[:3] = R @ move[:3]
    e[3:] = TURN_SCALE * (R @ move[3:])
    return damped_step(J, e, _DAMPING, np.zeros(tree.arm), np.inf)
