"""The network that is trained; `clone` runs it in numpy."""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dexgrasp.imitation.policy import FARTHEST
from dexgrasp.imitation.settings import CloneNetwork
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch
    from torch import nn


class CloneNet(nn.Module):
    """Features, and with a cloud its code, to the set-points of the next steps, in units of their spread."""

    def __init__(
        self, sizes: CloneNetwork, mean: NDArray[np.float32], scale: NDArray[np.float32], with_cloud: bool
    ) -> None:
        """Prepare.

        Args:
            sizes: of the layers.
            mean: (F,) of the features.
            scale: (F,) of the features.
            with_cloud: whether there is a cloud.
        """
        super().__init__()
        self.mean: torch.Tensor
        self.scale: torch.Tensor
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("scale", torch.from_numpy(scale))
        self.encoder = _mlp([3, sizes.local, sizes.cloud]) if with_cloud else None
        width = len(mean) + (sizes.cloud if with_cloud else 0)
        self.trunk = _mlp([width, *[sizes.hidden] * sizes.layers, 23 * sizes.chunk])

    def forward(self, looks: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
        """Return (E, R, chunk * 23) for features (E, R, F) of E episodes and their clouds (E, N, 3)."""
        x = ((looks - self.mean) / self.scale).clamp(-FARTHEST, FARTHEST)
        if self.encoder is not None:
            code = torch.relu(self.encoder(points)).amax(dim=1)
            x = torch.cat([x, code[:, None].expand(-1, x.shape[1], -1)], dim=-1)
        return self.trunk(x)

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """Return the arrays as `clone` reads them."""
        out = {"mean": self.mean.cpu().numpy(), "scale": self.scale.cpu().numpy()}
        return out | layer_arrays("encoder", self.encoder or ()) | layer_arrays("trunk", self.trunk)


def layer_arrays(name: str, layers: Iterable[nn.Module]) -> dict[str, NDArray[np.float32]]:
    """Return weights and biases of the linear ones of `layers`, as `policy.Mlp` reads them."""
    linear = enumerate(layer for layer in layers if isinstance(layer, nn.Linear))
    return {
        f"{name}.{k}.{part}": tensor.detach().cpu().numpy()
        for k, layer in linear
        for part, tensor in layer.named_parameters()
    }


def _mlp(widths: list[int]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for k, (a, b) in enumerate(pairwise(widths)):
        layers += ([nn.ReLU()] if k else []) + [nn.Linear(a, b)]
    return nn.Sequential(*layers)
