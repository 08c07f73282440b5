"""Policy cloned from the state, in numpy: predicts a chunk of set-points, executes a part of it, and repeats."""

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.data.demonstrations.convert import to_action
from dexgrasp.learning.imitation.policy import Mlp, Policy, Scaling
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.runs.weights import Weights, relu
from dexgrasp_env.arrays import Array, Fields, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.tasks.features import entry, features, initial_scene


class BcPolicy(Policy):
    """Policy that predicts the set-points of the next control steps."""

    kind = "clone"

    def _read(self, about: Fields, arrays: Weights) -> bool:
        self.chunk, self.execute = int(about["chunk"]), int(about["execute"])
        if not 1 <= self.execute <= self.chunk:
            raise InputError(f"the policy executes {self.execute} of {self.chunk} steps: valid are 1 to all")
        self.scaling, self._unit = Scaling(arrays["mean"], arrays["scale"]), arrays["unit"]
        self._trunk = Mlp(arrays, "trunk", relu)
        self.joints = self._unit.size // self.chunk
        return (
            about["view"] == "state"
            and self.env.get("control_mode") in ("joint_delta", "joint_position")
            and self._trunk.inputs == len(self.scaling.mean)
            and self._trunk.outputs == self.joints * self.chunk == self._unit.size
        )

    def begin(self, first: Observation, cell: Cell) -> "BcRun":
        """Start an episode in a cell."""
        return BcRun(self, first, cell)

    def predict(self, inputs: Array) -> Array:
        """Return the set-points of the next steps relative to now, (n, chunk, joints) rad, for features (n, F)."""
        out = self._trunk(self.scaling(inputs)) * self._unit
        return out.reshape(len(inputs), self.chunk, self.joints).astype(float)


class BcRun:
    """Cloned policy in one episode."""

    def __init__(self, clone: BcPolicy, first: Observation, cell: Cell) -> None:
        """Start at the first observation."""
        self._clone, self._tree, self._scene = clone, robot_tree(cell), initial_scene(first)
        self._step, self._wanted = 0, np.zeros((0, clone.joints))

    def set_points(self, observation: Observation) -> Array:
        """Return the set-points (n,) rad for the end of the next control step."""
        at = self._step % self._clone.execute
        if at == 0:
            inputs = features(self._scene, observation, self._step)
            wanted = entry(observation, "joint_targets") + self._clone.predict(inputs[None])[0]
            self._wanted = np.clip(wanted, self._tree.lower, self._tree.upper)
        self._step += 1
        return self._wanted[at]

    def action(self, observation: Observation) -> Single:
        """Return the next action, in the policy's control mode."""
        now = entry(observation, "joint_targets")
        return to_action(self._clone.env["control_mode"], now, self.set_points(observation), self._tree)
