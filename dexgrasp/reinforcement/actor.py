"""A policy of reinforcement at work, in numpy: alone, or correcting a clone."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp.imitation.clone import FARTHEST, Clone
from dexgrasp.imitation.features import Observation, features, first_look
from dexgrasp.imitation.policy import Mlp, Policy, relu
from dexgrasp.runs.arrays import below
from dexgrasp.runs.policy_folder import Arrays
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.cell import Cell

KIND = "actor"
Scaling = tuple[Any, Any]
"""Mean and spread (F,) of features."""


class Actor(Policy):
    """The network: features, and what the clone would do, to an action or to a correction of the clone's."""

    def _read(self, about: Mapping[str, Any], arrays: Arrays) -> bool:
        self.share, self._squashed = float(about["share"]), bool(about["squashed"])
        self.scaling = arrays["mean"].astype(float), arrays["scale"].astype(float)
        self._actor = Mlp(arrays, "actor", np.tanh if about["activation"] == "tanh" else relu)
        self.base = Clone(about["base"], below(arrays, "base.")) if about.get("base") else None
        inputs, outputs = len(self.scaling[0]), self._actor.outputs
        if self.base is None:
            return self._actor.inputs == inputs
        return self._actor.inputs == inputs + outputs and self.base.joints == outputs

    def begin(self, first: Observation, cell: Cell) -> "ActorRun":
        """Start an episode in a cell."""
        return ActorRun(self, first, cell)

    def correction(self, looks: Array) -> Array:
        """Return the network's output (m,) in [-1, 1] for what `Eye.look` returns."""
        x = self._actor(looks.astype(np.float32))
        return np.asarray(np.tanh(x) if self._squashed else np.clip(x, -1.0, 1.0), dtype=float)


class ActorRun:
    """An actor in one episode."""

    def __init__(self, actor: Actor, first: Observation, cell: Cell) -> None:
        self._actor, self._eye = actor, Eye(actor.scaling, actor.base, actor.share, cell, first)

    def action(self, observation: Observation) -> NDArray[np.float32]:
        """Return the next action."""
        return self._eye.carried_out(self._actor.correction(self._eye.look(observation)))


class Eye:
    """What an actor's network is given in one episode, and what comes of its answers."""

    def __init__(
        self, scaling: Scaling, clone: Clone | None, share: float, cell: Cell, first: Observation
    ) -> None:
        """Look at the first observation.

        Args:
            scaling: of the features.
            clone: that acts along, or None.
            share: of the network's action that is carried out.
            cell: of the robot.
            first: observation of the episode.

        Raises:
            InputError: where there is nothing to look at.
        """
        self._scaling, self._share, self._step = scaling, share, 0
        self._scene = first_look("state", first)
        self._clone = None if clone is None else clone.begin(first, cell)
        self._clones: Any = 0.0

    def look(self, observation: Observation) -> Array:
        """Return what the network is given now: scaled features, and the clone's action (m,)."""
        mean, scale = self._scaling
        looks = features("state", self._scene, observation, self._step)
        self._step += 1
        scaled = np.clip((looks - mean) / scale, -FARTHEST, FARTHEST)
        if self._clone is None:
            return scaled
        self._clones = self._clone.action(observation).astype(float)
        return np.concatenate([scaled, self._clones])

    def carried_out(self, action: Array) -> NDArray[np.float32]:
        """Return the action that is carried out: a share of the network's, on the clone's where there is one."""
        return np.clip(self._clones + self._share * action, -1.0, 1.0).astype(np.float32)
