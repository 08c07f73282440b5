"""The completion network: from the support function of the seen side to that of the whole object, with its spread."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dexgrasp.geometry.visible_side import UNIT, WRITTEN, VisibleSide
from dexgrasp.runs.arrays import Layer, layers_of, read_arrays, relu, through
from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.assets import asset_path


@dataclass(frozen=True, eq=False)
class CompletionNetwork:
    """A perceptron in numpy; arrays are float32.

    Attributes:
        mean, scale: (391,) of the features it was trained on.
        layers: weights (in, out) and biases.
    """

    mean: Single
    scale: Single
    layers: tuple[Layer, ...]

    def complete(self, view: VisibleSide) -> tuple[Array, Array]:
        """Return the whole object's support (361,) in the directions `WRITTEN`, UNIT, and its spread (361,), m.

        The spread is the mean absolute error that the network expects of itself.
        """
        x = ((view.features() - self.mean) / self.scale).astype(np.float32)
        more, log_spread = np.split(through(self.layers, x, relu).astype(float), [len(WRITTEN)])
        unit = 0.01  # m: the network answers in this unit
        spread = unit * np.exp(np.clip(log_spread, -4.0, 3.0))
        return view.seen() + more * unit / UNIT, spread


@lru_cache(maxsize=1)
def shipped_network() -> CompletionNetwork:
    """Return the network that comes with the package."""
    arrays, _ = read_arrays(asset_path("weights/unseen.safetensors"))
    return CompletionNetwork(arrays["mean"], arrays["scale"], layers_of(arrays, "network"))
