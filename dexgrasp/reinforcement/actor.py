"""A policy of reinforcement at work, in numpy: alone, or correcting a clone."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dexgrasp.imitation.clone import Clone
from dexgrasp.imitation.features import Observation, features, first_look
from dexgrasp.imitation.policy import Mlp, Policy, Scaling, relu
from dexgrasp.runs.arrays import below
from dexgrasp.runs.policy_folder import Arrays
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.cell import Cell

KIND = "actor"


class Acting(NamedTuple):
    """How a network's answers become actions.

    Attributes:
        scaling: of the features that it is given.
        clone: that acts along, or None.
        share: of the network's action that is carried out, on the clone's.
    """

    scaling: Scaling
    clone: Clone | None
    share: float


class Actor(Policy):
    """The network: features, and what the clone would do, to an action or to a correction of the clone's."""

    def _read(self, about: Mapping[str, Any], arrays: Arrays) -> bool:
        scaling, self._squashed = Scaling(arrays["mean"], arrays["scale"]), bool(about["squashed"])
        clone = Clone(about["base"], below(arrays, "base.")) if about.get("base") else None
        self.acting = Acting(scaling, clone, float(about["share"]))
        self._actor = Mlp(arrays, "actor", np.tanh if about["activation"] == "tanh" else relu)
        inputs, outputs = len(scaling.mean), self._actor.outputs
        if clone is None:
            return self._actor.inputs == inputs
        return self._actor.inputs == inputs + outputs and clone.joints == outputs

    def begin(self, first: Observation, cell: Cell) -> "ActorRun":
        """Start an episode in a cell."""
        return ActorRun(self, first, cell)

    def correction(self, looks: NDArray[np.float32]) -> Array:
        """Return the network's output (m,) in [-1, 1] for what `Eye.look` returns."""
        x = self._actor(looks)
        return np.asarray(np.tanh(x) if self._squashed else np.clip(x, -1.0, 1.0), dtype=float)


class Eye:
    """What a network is given in one episode, and what comes of its answers."""

    def __init__(self, acting: Acting, first: Observation, cell: Cell) -> None:
        """Look at the first observation.

        Raises:
            InputError: where there is nothing to look at, or the robot is another.
        """
        self._acting, self._scene, self._step = acting, first_look("state", first), 0
        self._clone = None if acting.clone is None else acting.clone.begin(first, cell)
        self._clones: Any = 0.0

    def look(self, observation: Observation) -> NDArray[np.float32]:
        """Return what the network is given now: scaled features, and the clone's action (m,)."""
        looks = self._acting.scaling(features("state", self._scene, observation, self._step))
        self._step += 1
        if self._clone is None:
            return looks
        self._clones = self._clone.action(observation)
        return np.concatenate([looks, self._clones])

    def carried_out(self, action: Array) -> NDArray[np.float32]:
        """Return the action that is carried out: a share of the network's, on the clone's where there is one."""
        return np.clip(self._clones + self._acting.share * action, -1.0, 1.0).astype(np.float32)


class ActorRun(Eye):
    """An actor in one episode."""

    def __init__(self, actor: Actor, first: Observation, cell: Cell) -> None:
        super().__init__(actor.acting, first, cell)
        self._actor = actor

    def action(self, observation: Observation) -> NDArray[np.float32]:
        """Return the next action."""
        return self.carried_out(self._actor.correction(self.look(observation)))
