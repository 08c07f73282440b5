"""The half of the CVAE that proposes grasps, in numpy: planning needs no torch; `learning.cvae` trains it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dexgrasp.runs.weights import Layer, layers_of, read_arrays, relu, through
from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Count

SCHEMA = 1
SCALE = 10.0
"""Units a metre inside the network."""
PALM = 9
"""Numbers of a grasp's palm, behind those of its tips (3 each): position (3), first two columns of its rotation (6)."""

CROPPED = 0.002
"""m: points of a cloud below are left out, as no camera sees the underside."""


def centre_of(points: Array) -> Array:
    """Return what is subtracted from a cloud (N, 3): its mean in x and y, nothing in z."""
    return np.array([*points[:, :2].mean(0), 0.0])


@dataclass(frozen=True)
class NetworkSettings:
    """Sizes of the network.

    Attributes:
        latent: size of the latent.
        points: of a cloud.
        local: width of the points' features.
        cloud: width of a cloud's feature.
        hidden: width of the other layers.
    """

    latent: Count = 6
    points: Count = 512
    local: Count = 64
    cloud: Count = 256
    hidden: Count = 320


@dataclass(frozen=True, eq=False)
class Decoder:
    """Encoder of clouds and decoder of latents, float32, network units.

    Attributes:
        settings: sizes.
        first: of the cloud encoder, each point by itself.
        beside: what a point is told of the whole cloud.
        second: each point beside the whole.
        layers: of the decoder.
        hand: whose grasps it has learned, as `Hand.stamp` says it; None where nobody says.
    """

    settings: NetworkSettings
    first: tuple[Layer, ...]
    beside: tuple[Layer, ...]
    second: tuple[Layer, ...]
    layers: tuple[Layer, ...]
    hand: str | None = None

    def feature(self, cloud: Single) -> Single:
        """Return the feature (cloud,) of a cloud (N, 6) of points and unit normals."""
        each = relu(through(self.first, cloud, relu))
        whole = through(self.beside, each.max(0), relu)
        return through(self.second, each + whole, relu).max(0)

    def decode(self, feature: Single, latent: Single) -> Single:
        """Return grasps (K, 3 n + 9) of a cloud's feature and latents (K, latent)."""
        (weight, bias), *rest = self.layers
        # The cloud's share of the first layer is the same for all latents.
        first = latent @ weight[len(feature) :] + (feature @ weight[: len(feature)] + bias)
        return through(tuple(rest), _silu(first), _silu) if rest else first


def read_decoder(path: Path) -> Decoder:
    """Return the decoder of a file of weights.

    Raises:
        InputError: missing, damaged, or of another schema; without safetensors.
    """
    arrays, note = read_arrays(path)
    parts = {"first": "cloud.first", "beside": "cloud.beside", "second": "cloud.second", "layers": "decoder"}
    try:
        if note["schema"] != SCHEMA:
            raise KeyError
        settings = NetworkSettings(**note["network"])
        layers = {part: layers_of(arrays, name) for part, name in parts.items()}
        return Decoder(settings, **layers, hand=note.get("hand"))
    except (KeyError, TypeError):
        raise InputError(
            f"{path} holds no weights of schema {SCHEMA}: train them with `dexgrasp train cvae`"
        ) from None


def _silu(x: Single) -> Single:
    with np.errstate(over="ignore"):  # exp(-x) of a large -x is infinite, and x / infinity what it should be
        shrink = np.negative(x)
        np.exp(shrink, out=shrink)
        shrink += 1.0
        x /= shrink
        return x
