"""Base of learned policies in numpy, and the perceptrons that they are made of."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from dexgrasp.agent import Observation
from dexgrasp.runs.weights import Weights, through
from dexgrasp_env.arrays import Array, Fields, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell, default_cell

FARTHEST = 6.0
"""Standard deviations that features are clipped at."""


class PolicyRun(Protocol):
    """Policy in one episode."""

    def action(self, observation: Observation) -> Single:
        """Return the next action."""


class Policy(ABC):
    """Base of policies: read from a folder, and started anew for each episode.

    Attributes:
        kind: name of the class in `policy.json`.
        env: keywords of `gym.make` that it needs.
        robot: `Robot.stamp` of the robot that it moves; ours where the file does not state one.
    """

    kind: str

    def __init__(self, about: Fields, arrays: Weights) -> None:
        """Take the result of `read_policy`.

        Raises:
            InputError: if arrays are missing or do not fit.
        """
        try:
            self.env = {str(key): value for key, value in about["env"].items()}
            self.robot = str(about.get("robot") or default_cell().robot.stamp)
            fits = self._read(about, arrays)
        except InputError:
            raise
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise InputError(f"the policy is incomplete ({error})") from None
        if not fits:
            raise InputError("the policy's arrays do not fit what it says of itself")

    def check_robot(self, cell: Cell) -> None:
        """Refuse another robot than that of the training.

        Raises:
            InputError: naming both.
        """
        if self.robot != cell.robot.stamp:
            raise InputError(
                f"the policy moves the robot {self.robot}, not {cell.robot.stamp}: train one of its own"
            )

    @abstractmethod
    def _read(self, about: Fields, arrays: Weights) -> bool:
        """Read the policy's own keys and arrays; return True if they fit together."""

    @abstractmethod
    def begin(self, first: Observation, cell: Cell) -> PolicyRun:
        """Start an episode in a cell at its first observation.

        Raises:
            InputError: for an observation without what it needs.
        """


class Scaling(NamedTuple):
    """Mean and spread (F,) of features."""

    mean: Any
    scale: Any

    def __call__(self, features: Array) -> Single:
        """Return normalised features (..., F), clipped at `FARTHEST`."""
        return np.clip((features - self.mean) / self.scale, -FARTHEST, FARTHEST).astype(np.float32)


class Mlp:
    """Linear layers with an activation between them, float32."""

    def __init__(self, arrays: Weights, name: str, activation: Callable[[Any], Any]) -> None:
        """Take the layers `name.K.weight` (out, in) and `name.K.bias` (out,).

        Raises:
            IndexError: if there are none.
            ValueError: if one does not fit the one before it.
        """
        count = sum(key.startswith(f"{name}.") for key in arrays) // 2
        layers = ((arrays[f"{name}.{k}.weight"].T, arrays[f"{name}.{k}.bias"]) for k in range(count))
        self._layers, self._activation = tuple(layers), activation
        self.inputs = len(self._layers[0][0])
        self.outputs = self(np.zeros(self.inputs, np.float32)).size

    def __call__(self, x: Single) -> Single:
        """Return outputs (..., outputs) for inputs (..., inputs)."""
        return through(self._layers, x, self._activation)
