"""A policy of reinforcement at work, in numpy: alone, or correcting a clone."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp.imitation.clone import FARTHEST, Clone, CloneRun, Layers, read_layers
from dexgrasp.imitation.features import Observation, Scene, features, first_look
from dexgrasp.runs.policy_folder import Arrays
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.robot import Robot

KIND = "actor"
_BASE = "base."


class Actor:
    """The network: features, and what the clone would do, to an action or to a correction of the clone's."""

    def __init__(self, about: Mapping[str, Any], arrays: Arrays) -> None:
        """Check what was read.

        Raises:
            InputError: if arrays are missing or do not fit.
        """
        try:
            self.env = {str(key): value for key, value in about["env"].items()}
            self.share = float(about["share"])
            self._tanh, self._squashed = about["activation"] == "tanh", bool(about["squashed"])
            self._scaling = arrays["mean"].astype(float), arrays["scale"].astype(float)
            self._layers: Layers = read_layers(arrays, "actor")
            own = {key.removeprefix(_BASE): array for key, array in arrays.items() if key.startswith(_BASE)}
            self.base = Clone(about["base"], own) if about.get("base") else None
            actions = self._layers[-1][1].size
            width = len(self._scaling[0]) + (actions if self.base else 0)
            fits = self._layers[0][0].shape[1] == width and (not self.base or actions == self.base.joints)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise InputError(f"the policy is incomplete ({error})") from None
        if not fits:
            raise InputError("the policy's arrays do not fit what it says of itself")

    def begin(self, first: Observation, cell: Cell) -> "ActorRun":
        """Start an episode in a cell.

        Raises:
            InputError: where there is nothing to look at.
        """
        return ActorRun(self, first, cell.robot)

    def correction(self, looks: Array) -> Array:
        """Return the network's output (m,) in [-1, 1] for what `look` returns."""
        x = looks.astype(np.float32)
        for k, (weight, bias) in enumerate(self._layers):
            x = (self._bent(x) if k else x) @ weight.T + bias
        return np.asarray(np.tanh(x) if self._squashed else np.clip(x, -1.0, 1.0), dtype=float)

    def look(self, scene: Scene, observation: Observation, step: int, clones: Array | None) -> Array:
        """Return what the network is given: scaled features, and the clone's action (m,)."""
        return network_input(self._scaling, scene, observation, step, clones)

    def _bent(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.tanh(x) if self._tanh else np.maximum(x, 0.0)


class ActorRun:
    """An actor in one episode."""

    def __init__(self, actor: Actor, first: Observation, robot: Robot) -> None:
        self._actor, self._step = actor, 0
        self._scene = first_look("state", first)
        self._clone = None if actor.base is None else CloneRun(actor.base, first, robot)

    def action(self, observation: Observation) -> NDArray[np.float32]:
        """Return the next action."""
        clones = None if self._clone is None else self._clone.action(observation).astype(float)
        looks = self._actor.look(self._scene, observation, self._step, clones)
        self._step += 1
        return combined(self._actor.correction(looks), clones, self._actor.share)


def network_input(
    scaling: tuple[Array, Array], scene: Scene, observation: Observation, step: int, clones: Array | None
) -> Array:
    """Return what the network of an actor is given for one observation: scaled features, and the clone's action."""
    mean, scale = scaling
    looks = features("state", scene, observation, step)
    scaled = np.clip((looks - mean) / scale, -FARTHEST, FARTHEST)
    return scaled if clones is None else np.concatenate([scaled, clones])


def combined(action: Array, clones: Array | None, share: float) -> NDArray[np.float32]:
    """Return the action that is carried out: the network's, or the clone's with a share of the network's on it."""
    whole = action if clones is None else clones + share * action
    return np.clip(whole, -1.0, 1.0).astype(np.float32)
