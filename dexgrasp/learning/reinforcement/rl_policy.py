"""Policies of reinforcement learning in numpy: a network alone, or one that corrects the actions of a cloned policy."""

from typing import Any, NamedTuple

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.learning.imitation.bc_policy import BcPolicy, BcRun
from dexgrasp.learning.imitation.policy import Mlp, Policy, Scaling
from dexgrasp.runs.arrays import below, relu
from dexgrasp.runs.policy_folder import Weights
from dexgrasp_env.arrays import Array, Fields, Index, Single
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.tasks.control import GRASP_MODES, GRASP_SIZE
from dexgrasp_env.tasks.features import InitialScene, features, initial_scene, stack_scenes

_STORED = {"share": "residual_scale", "hold": "action_repeat", "chunk": "action_chunk"}
"""Names of 0.3.0 in `policy.json`, and today's."""
FARTHEST = 3.0
"""That a network's answers may be from 0 in the grasp space, which mirrors what lies beyond 1."""


class ActionSpec(NamedTuple):
    """The way from a network's output to actions of the environment.

    Attributes:
        scaling: of the features that it is given.
        clone: cloned policy whose actions are corrected, or None.
        residual_scale: factor on the network's action, on top of the clone's.
        action_repeat: control steps for which an action is held.
        grasps: whether actions are of the grasp space.
        action_chunk: consecutive actions in one output.
        once: whether one output is a whole episode's; its last action then stands until the end.
    """

    scaling: Scaling
    clone: BcPolicy | None
    residual_scale: float
    action_repeat: int
    grasps: bool
    action_chunk: int
    once: bool

    @property
    def span(self) -> int:
        """Control steps of one output."""
        return self.action_repeat * self.action_chunk

    def action(self, outputs: Array, step: int) -> Array:
        """Return the actions (N, m) of outputs (N, action_chunk * m) at a control step since they were given."""
        return outputs.reshape(len(outputs), self.action_chunk, -1)[:, step // self.action_repeat]


class RlPolicy(Policy):
    """A network from features, and the clone's action, to an action or to a correction of the clone's."""

    kind = "actor"

    def _read(self, about: Fields, arrays: Weights) -> bool:
        about = {_STORED.get(name, name): value for name, value in about.items()}
        scaling, self._squashed = Scaling(arrays["mean"], arrays["scale"]), bool(about["squashed"])
        clone = BcPolicy(about["base"], below(arrays, "base.")) if about.get("base") else None
        repeat, chunk = (int(about.get(name, 1)) for name in ("action_repeat", "action_chunk"))
        if about.get("grasps") and self.env.get("control_mode") == "ee_delta":  # as 0.3.0 has it
            self.env["control_mode"] = "grasp"
        grasps = self.env.get("control_mode") in GRASP_MODES
        scale, once = float(about["residual_scale"]), bool(about.get("once"))
        self.spec = ActionSpec(scaling, clone, scale, repeat, grasps, chunk, once)
        self._actor = Mlp(arrays, "actor", np.tanh if about["activation"] == "tanh" else relu)
        inputs, outputs = len(scaling.mean), self._actor.outputs
        if min(repeat, chunk) < 1 or outputs % chunk:
            return False
        if clone is None:
            return self._actor.inputs == inputs and (not grasps or outputs == GRASP_SIZE * chunk)
        return self._actor.inputs == inputs + clone.joints and clone.joints * chunk == outputs

    def begin(self, first: Observation, cell: Cell) -> "RlRun":
        """Start an episode in a cell."""
        return RlRun(self, first, cell)

    def output(self, encoded: Single) -> Array:
        """Return the network's output (..., m) for encoded observations: in [-1, 1], or for the grasp space."""
        x, farthest = self._actor(encoded), FARTHEST if self.spec.grasps else 1.0
        return (np.tanh(x) if self._squashed else np.clip(x, -farthest, farthest)).astype(float)


class ObservationEncoder:
    """Network inputs of N episodes side by side, and environment actions from its outputs."""

    def __init__(self, spec: ActionSpec, firsts: Observation, cell: Cell) -> None:
        """Take the first observations, (N, n) by key.

        Raises:
            InputError: where there is nothing to look at, or the robot is another.
        """
        self._spec, self._cell = spec, cell
        every = [one(firsts, i) for i in range(len(firsts["joint_targets"]))]
        self._scenes = stack_scenes([initial_scene(first) for first in every])
        self._clones = [self._clone(first) for first in every]
        self._steps = np.zeros(len(every), np.int64)
        self._cloned: Any = 0.0

    def begin(self, i: int, first: Observation) -> None:
        """Begin episode `i` anew, at its first observation."""
        for values, own in zip(self._scenes, initial_scene(first), strict=True):
            values[i] = own
        self._clones[i] = self._clone(first)
        self._steps[i] = 0

    def _clone(self, first: Observation) -> BcRun | None:
        clone = self._spec.clone
        return clone.begin(first, self._cell) if clone else None

    def encode(self, observations: Observation) -> Single:
        """Return the network's inputs now, (N, F): scaled features, and the clones' actions."""
        encoded = self._features(self._scenes, observations, self._steps)
        self._steps += self._spec.span
        if self._spec.clone is None:
            return encoded
        self._cloned = np.stack(
            [clone.action(one(observations, i)) for i, clone in enumerate(self._clones) if clone]
        )
        return np.concatenate([encoded, self._cloned], axis=-1)

    def encode_last(self, i: int, observation: Observation) -> Single:
        """Return the network's input (F,) at the observation that episode `i` ended with."""
        scene = InitialScene(*(values[i : i + 1] for values in self._scenes))
        encoded = self._features(scene, _batch_of_one(observation), self._steps[i : i + 1])[0]
        clone = self._clones[i]
        return np.concatenate([encoded, clone.action(observation)]) if clone else encoded

    def _features(self, scenes: InitialScene, observations: Observation, steps: Index) -> Single:
        seen = features(scenes, observations, steps)
        if self._spec.grasps:
            seen = np.concatenate([seen, observations["grasp_state"]], axis=-1)
        return self._spec.scaling(seen)

    def env_actions(self, actions: Array) -> Single:
        """Return the environments' actions (N, m): the network's, scaled and added to the clones' where they are."""
        if self._spec.grasps:
            return actions.astype(np.float32)
        return np.clip(self._cloned + self._spec.residual_scale * actions, -1.0, 1.0).astype(np.float32)


class RlRun(ObservationEncoder):
    """A policy of reinforcement learning in one episode."""

    def __init__(self, policy: RlPolicy, first: Observation, cell: Cell) -> None:
        super().__init__(policy.spec, _batch_of_one(first), cell)
        self._policy, self._step = policy, 0
        self._output = np.zeros(0)

    def action(self, observation: Observation) -> Single:
        """Return the next action."""
        span = self._spec.span
        step = min(self._step, span - 1) if self._spec.once else self._step % span
        if step == 0 and not (self._spec.once and self._step):
            self._output = self._policy.output(self.encode(_batch_of_one(observation)))
        self._step += 1
        return self.env_actions(self._spec.action(self._output, step))[0]


def one(observations: Observation, i: int) -> Observation:
    """Return the observation of environment `i`."""
    return {key: values[i] for key, values in observations.items()}


def _batch_of_one(observation: Observation) -> Observation:
    return {key: np.asarray(values)[None] for key, values in observation.items()}
