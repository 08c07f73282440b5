"""Policies of reinforcement at work, in numpy: alone, or correcting the actions of a clone, or its grip."""

from typing import Any, NamedTuple

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.data.demonstrations.convert import to_action
from dexgrasp.learning.imitation.clone import Clone, CloneRun
from dexgrasp.learning.imitation.features import Scene, entry, features, first_look, side_by_side
from dexgrasp.learning.imitation.policy import Mlp, Policy, Scaling
from dexgrasp.learning.reinforcement.grasp_space import FARTHEST, SIZE, GraspSpace, bends
from dexgrasp.mechanics.kinematics.damped import damped_step
from dexgrasp.mechanics.kinematics.forward import empty_frames, forward
from dexgrasp.mechanics.kinematics.palm_ik import TURN_SCALE, palm_jacobian
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.runs.arrays import below, relu
from dexgrasp.runs.policy_folder import Weights
from dexgrasp_env.arrays import Array, Fields, Single
from dexgrasp_env.compiled import njit
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.tasks.control import max_step

_PALM = {"deeper": (0, 0.03), "over": (2, 0.03), "tilted": (3, 0.2)}
"""Axis of the palm, and m along it or (from 3 on) rad about it at 1."""
_FINGERS = {
    "curled": {
        ("index", 1): 0.2, ("index", 2): 0.4, ("index", 3): 0.3,
        ("middle", 1): 0.2, ("middle", 2): 0.4, ("middle", 3): 0.3,
    },
    "thumb": {("thumb", 1): 0.4},
}  # fmt: skip
"""Synergies: rad of each joint at 1."""
GRIP_SIZE = len(_PALM) + len(_FINGERS)
"""Numbers of a correction, each from -1 to 1."""
_RAMP = 30  # control steps until it is there in full, well before the hand closes
_DAMPING = 1e-4  # of the step from palm to arm


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
    clone: Clone | None
    share: float
    hold: int
    grasps: bool
    chunk: int
    once: bool

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
        share = float(about["share"])
        self.acting = Acting(scaling, clone, share, hold, grasps, chunk, bool(about.get("once")))
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
        x, farthest = self._actor(looks), FARTHEST if self.acting.grasps else 1.0
        return (np.tanh(x) if self._squashed else np.clip(x, -farthest, farthest)).astype(float)


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
        for values, own in zip(self._scenes, first_look(first), strict=True):
            values[i] = own
        if self._space:
            self._space.begin(slice(i, i + 1), _alone(first))
        self._clones[i] = self._clone(first)
        self._steps[i] = 0

    def _clone(self, first: Observation) -> CloneRun | None:
        clone = self._acting.clone
        return clone.begin(first, self._cell) if clone else None

    def look(self, observations: Observation) -> Single:
        """Return what the network is given now, (N, F): scaled features, and the clones' actions."""
        looks = self._see(self._scenes, observations, slice(None))
        self._steps += self._acting.span
        if self._acting.clone is None:
            return looks
        self._cloned = np.stack(
            [clone.action(one(observations, i)) for i, clone in enumerate(self._clones) if clone]
        )
        return np.concatenate([looks, self._cloned], axis=-1)

    def last(self, i: int, observation: Observation) -> Single:
        """Return what the network would be given of the observation that episode `i` ended with, (F,)."""
        scene = Scene(*(values[i : i + 1] for values in self._scenes))
        looks = self._see(scene, _alone(observation), slice(i, i + 1))[0]
        clone = self._clones[i]
        return np.concatenate([looks, clone.action(observation)]) if clone else looks

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


class Grip(Policy):
    """A clone whose grip a network corrects: once, from the first look, it shifts the palm and bends the fingers.

    A servo that saturates squeezes no harder, so corrections of single actions win little. What bears pushes is where
    the hand takes hold, and in which posture: a few numbers an episode, which a thousand episodes teach. They are added
    to the set-points of the clone, which goes on as if they were not there.
    """

    kind = "grip"

    def _read(self, about: Fields, arrays: Weights) -> bool:
        self.clone = Clone(about["base"], below(arrays, "base."))
        self._actor = Mlp(arrays, "actor", np.tanh)
        sized = self._actor.inputs == len(self.clone.scaling.mean) and self._actor.outputs == GRIP_SIZE
        return sized and self.env == self.clone.env

    def begin(self, first: Observation, cell: Cell) -> "GripRun":
        """Decide on the correction and start an episode in a cell."""
        return GripRun(self.clone, first, self.correction(look(self.clone, first)), cell)

    def correction(self, looks: Single) -> Array:
        """Return the correction (GRIP_SIZE,) for what `look` returns."""
        return np.clip(self._actor(looks), -1.0, 1.0).astype(float)


class GripRun:
    """A corrected clone in one episode."""

    def __init__(self, clone: Clone, first: Observation, correction: Array, cell: Cell) -> None:
        """Start an episode.

        Args:
            clone: that acts.
            first: observation.
            correction: (GRIP_SIZE,) in [-1, 1].
            cell: of the robot.
        """
        self._robot, self._tree = cell.robot, robot_tree(cell)
        self._run, self._step = CloneRun(clone, first, cell), 0
        self._own = np.array(first["joint_targets"], dtype=float)  # the clone's set-points, not corrected
        axes, sizes = zip(*_PALM.values(), strict=True)
        self._palm = np.zeros(6)
        self._palm[list(axes)] = correction[: len(_PALM)] * sizes
        self._fingers = correction[len(_PALM) :] @ bends(cell.robot, _FINGERS)

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


def look(clone: Clone, first: Observation) -> Single:
    """Return what the network is given: the first observation's features (F,), scaled as the clone's."""
    return clone.scaling(features(first_look(first), first, 0))


@njit
def arm_step(q: Array, move: Array, tree: RobotTree) -> Array:
    """Return the change (a,) rad of the arm at `q` (n,) that shifts and turns the palm by `move` in its own axes.

    Args:
        q: (n,) rad.
        move: (6,) m and rad, small: one step of damped least squares.
        tree: the robot.
    """
    frames, J, e = empty_frames(tree), np.empty((6, tree.arm)), np.empty(6)
    forward(q, tree, frames)
    palm_jacobian(tree, frames, J)
    R = frames.R[tree.palm] @ tree.palm_rotation
    e[:3] = R @ move[:3]
    e[3:] = TURN_SCALE * (R @ move[3:])
    return damped_step(J, e, _DAMPING, np.zeros(tree.arm), np.inf)
