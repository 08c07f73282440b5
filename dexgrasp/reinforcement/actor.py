"""A policy of reinforcement at work, in numpy: alone, or correcting a clone."""

from typing import Any, NamedTuple

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.imitation.clone import Clone, CloneRun
from dexgrasp.imitation.features import Scene, features, first_look, side_by_side
from dexgrasp.imitation.policy import Mlp, Policy, Scaling
from dexgrasp.reinforcement.grasp_space import FARTHEST, SIZE, GraspSpace
from dexgrasp.runs.arrays import below, relu
from dexgrasp.runs.policy_folder import Weights
from dexgrasp_env.arrays import Array, Fields, Single
from dexgrasp_env.robot.cell import Cell


class Acting(NamedTuple):
    """How a network's answers become actions.

    Attributes:
        scaling: of the features that it is given.
        clone: that acts along, or None.
        share: of the network's action that is carried out, on the clone's.
        hold: control steps that an action stands for.
        grasps: whether actions are of a `GraspSpace`.
        chunk: actions, one after the other, that an answer holds.
        once: whether one answer is an episode's; its last action stands until the end.
    """

    scaling: Scaling
    clone: Clone | None = None
    share: float = 1.0
    hold: int = 1
    grasps: bool = False
    chunk: int = 1
    once: bool = False

    @property
    def span(self) -> int:
        """Control steps that an answer stands for."""
        return self.hold * self.chunk

    def action(self, answers: Array, step: int) -> Array:
        """Return the actions (N, m) of answers (N, chunk * m) at a control step from the look on."""
        return answers.reshape(len(answers), self.chunk, -1)[:, step // self.hold]


class Actor(Policy):
    """The network: features, and what the clone would do, to an action or to a correction of the clone's."""

    kind = "actor"

    def _read(self, about: Fields, arrays: Weights) -> bool:
        scaling, self._squashed = Scaling(arrays["mean"], arrays["scale"]), bool(about["squashed"])
        clone = Clone(about["base"], below(arrays, "base.")) if about.get("base") else None
        hold, grasps, chunk = int(about.get("hold", 1)), bool(about.get("grasps")), int(about.get("chunk", 1))
        once = bool(about.get("once"))
        self.acting = Acting(scaling, clone, float(about["share"]), hold, grasps, chunk, once)
        self._actor = Mlp(arrays, "actor", np.tanh if about["activation"] == "tanh" else relu)
        inputs, outputs = len(scaling.mean), self._actor.outputs
        if min(hold, chunk) < 1 or outputs % chunk:
            return False
        if clone is None:
            return self._actor.inputs == inputs and (not grasps or outputs == SIZE * chunk)
        return self._actor.inputs == inputs + clone.joints and clone.joints * chunk == outputs

    def begin(self, first: Observation, cell: Cell) -> "ActorRun":
        """Start an episode in a cell."""
        return ActorRun(self, first, cell)

    def correction(self, looks: Single) -> Array:
        """Return the network's output (..., m) for what `Eyes.look` returns: in [-1, 1], or for a `GraspSpace`."""
        x = self._actor(looks)
        farthest = FARTHEST if self.acting.grasps else 1.0
        within = np.clip(x, -farthest, farthest)
        return np.asarray(np.tanh(x) if self._squashed else within, dtype=float)


class Eyes:
    """What a network is given in N episodes side by side, and what comes of its answers."""

    def __init__(self, acting: Acting, firsts: Observation, cell: Cell) -> None:
        """Look at the first observations, (N, n) by key.

        Raises:
            InputError: where there is nothing to look at, or the robot is another.
        """
        self._acting, self._cell = acting, cell
        every = [one(firsts, i) for i in range(len(firsts["joint_targets"]))]
        self._scenes = side_by_side([first_look(first) for first in every])
        self._clones = [self._clone(first) for first in every]
        self._space = GraspSpace(cell.robot, firsts) if acting.grasps else None
        self._steps = np.zeros(len(every), np.int64)
        self._cloned: Any = 0.0

    def begin(self, i: int, first: Observation) -> None:
        """Begin episode `i` anew, at its first observation."""
        scene = first_look(first)
        for name, values in vars(self._scenes).items():
            values[i] = getattr(scene, name)
        if self._space:
            self._space.begin(slice(i, i + 1), _alone(first))
        self._clones[i] = self._clone(first)
        self._steps[i] = 0

    def _clone(self, first: Observation) -> CloneRun | None:
        clone = self._acting.clone
        return None if clone is None else clone.begin(first, self._cell)

    def look(self, observations: Observation) -> Single:
        """Return what the network is given now, (N, F): scaled features, and the clones' actions."""
        looks = self._see(self._scenes, observations, slice(None))
        self._steps += self._acting.span
        if self._acting.clone is None:
            return looks
        acted = [clone.action(one(observations, i)) for i, clone in enumerate(self._clones) if clone]
        self._cloned = np.stack(acted)
        return np.concatenate([looks, self._cloned], axis=-1)

    def last(self, i: int, observation: Observation) -> Single:
        """Return what the network would be given of the observation that episode `i` ended with, (F,)."""
        scene = Scene(*(values[i : i + 1] for values in vars(self._scenes).values()))
        looks = self._see(scene, _alone(observation), slice(i, i + 1))[0]
        clone = self._clones[i]
        return looks if clone is None else np.concatenate([looks, clone.action(observation)])

    def _see(self, scenes: Scene, observations: Observation, rows: slice) -> Single:
        seen = features(scenes, observations, self._steps[rows])
        if self._space:
            seen = np.concatenate([seen, self._space.look(observations, rows)], axis=-1)
        return self._acting.scaling(seen)

    def carried_out(self, actions: Array, observations: Observation) -> Single:
        """Return the actions (N, m) of a control step: a share of the network's, on the clones' where they are."""
        if self._space:
            return self._space.carried_out(actions, observations)
        return np.clip(self._cloned + self._acting.share * actions, -1.0, 1.0).astype(np.float32)


class ActorRun(Eyes):
    """An actor in one episode."""

    def __init__(self, actor: Actor, first: Observation, cell: Cell) -> None:
        super().__init__(actor.acting, _alone(first), cell)
        self._actor, self._step = actor, 0
        self._answer = np.zeros(0)

    def action(self, observation: Observation) -> Single:
        """Return the next action."""
        span = self._acting.span
        step = min(self._step, span - 1) if self._acting.once else self._step % span
        if step == 0 and not (self._acting.once and self._step):
            self._answer = self._actor.correction(self.look(_alone(observation)))
        self._step += 1
        return self.carried_out(self._acting.action(self._answer, step), _alone(observation))[0]


def one(observations: Observation, i: int) -> Observation:
    """Return the observation of environment `i`."""
    return {key: values[i] for key, values in observations.items()}


def _alone(observation: Observation) -> Observation:
    return {key: np.asarray(values)[None] for key, values in observation.items()}
