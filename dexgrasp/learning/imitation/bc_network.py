"""Networks of cloned policies in torch, for training; `bc_policy` and `cloud_grasp_policy` evaluate them in numpy."""

from collections.abc import Iterable

import numpy as np

from dexgrasp.learning.imitation.policy import FARTHEST
from dexgrasp.learning.imitation.settings import BcNetSizes, GraspNetSizes
from dexgrasp.learning.training.gradient_training import perceptron
from dexgrasp_env.arrays import Single
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch
    from torch import Tensor, nn


class PolicyNet(nn.Module):
    """Network with the normalisation of its features as buffers."""

    mean: Tensor
    scale: Tensor

    def __init__(self, **kept: Single) -> None:
        """Register arrays as buffers by name, with `mean` and `scale` (F,) of the features."""
        super().__init__()
        for name, array in kept.items():
            self.register_buffer(name, torch.from_numpy(array))

    def scaled(self, features: Tensor) -> Tensor:
        """Return normalised features (..., F)."""
        return ((features - self.mean) / self.scale).clamp(-FARTHEST, FARTHEST)

    def arrays(self) -> dict[str, Single]:
        """Return buffers and weights by the names that policies read."""
        out = {name: buffer.cpu().numpy() for name, buffer in self.named_buffers()}
        for name, layers in self.named_children():
            out |= layer_arrays(name, layers.children())
        return out


class BcNet(PolicyNet):
    """Network from features to the set-points of the next steps, in units of their spread."""

    unit: Tensor

    def __init__(self, sizes: BcNetSizes, mean: Single, scale: Single, unit: Single) -> None:
        """Prepare.

        Args:
            sizes: of the layers.
            mean: (F,) of the features.
            scale: (F,) of the features.
            unit: (chunk * joints,) rad, spread of the predictions.
        """
        super().__init__(mean=mean, scale=scale, unit=unit)
        self.trunk = perceptron([len(mean), *[sizes.hidden] * sizes.layers, len(unit)])

    def forward(self, features: Tensor) -> Tensor:
        """Return (E, R, chunk * joints) for features (E, R, F) of E episodes."""
        return self.trunk(self.scaled(features))


class GraspNet(PolicyNet):
    """Mixture network: from a cloud in the frame of a grip to logits and rows of numbers for grasps along it."""

    row_mean: Tensor
    row_scale: Tensor

    def __init__(self, sizes: GraspNetSizes, numbers: Single, rows: Single) -> None:
        """Prepare.

        Args:
            sizes: of the layers.
            numbers: (M, F) features of scenes, for their mean and scale.
            rows: (E, R) of grasps (see `grasp_to_row`), for their mean and scale.
        """
        super().__init__(
            mean=numbers.mean(0),
            row_mean=rows.mean(0),
            scale=np.maximum(numbers.std(0), 0.05),
            row_scale=np.maximum(rows.std(0), 0.02),
        )
        self.modes = sizes.modes
        self.encoder = perceptron([6, sizes.local, sizes.cloud])
        outputs = sizes.modes * (1 + rows.shape[1])
        self.trunk = perceptron([sizes.cloud + numbers.shape[1], *[sizes.width] * sizes.depth, outputs])

    def forward(self, points: Tensor, numbers: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits (..., modes) and rows (..., modes, R) for points (..., N, 6) and features (..., F)."""
        code = torch.relu(self.encoder(points)).amax(dim=-2)
        out = self.trunk(torch.cat([code, self.scaled(numbers)], dim=-1)).unflatten(-1, (self.modes, -1))
        return out[..., 0], self.row_mean + self.row_scale * out[..., 1:]


def layer_arrays(name: str, layers: Iterable[nn.Module]) -> dict[str, Single]:
    """Return weights and biases of the linear layers, by the names that `policy.Mlp` reads."""
    return {
        f"{name}.{k}.{part}": tensor.detach().cpu().numpy()
        for k, layer in enumerate(each for each in layers if isinstance(each, nn.Linear))
        for part, tensor in layer.named_parameters()
    }
