"""Conditional variational autoencoder: from a cloud and a latent to fingertips and a palm pose.

Clouds are centred at the mean of their points in x and y, z is the height above the table; lengths inside the network
are decimetres. A cloud is encoded once for all grasps on it.
"""

from typing import NamedTuple

from dexgrasp_env.extras import from_extra

with from_extra():
    import torch
    from torch import Tensor, nn

from dexgrasp.learning.training.gradient_training import perceptron
from dexgrasp.planning.decoder import PALM, SCALE, NetworkSettings


class Output(NamedTuple):
    """Output of a forward pass; a grasp is its fingertips, then the palm (`PALM`), in network units."""

    grasp: Tensor
    mean: Tensor
    log_variance: Tensor


class CloudEncoder(nn.Module):
    """Encoder of points and normals: two levels of shared layers with max pooling (PointNet, PointNet++).

    The second level has the feature of the whole cloud beside that of each point, so that it knows where on the object
    a point is: near its top, on its long side.
    """

    def __init__(self, settings: NetworkSettings) -> None:
        super().__init__()
        local = settings.local
        self.first = perceptron([6, local, 2 * local]).append(nn.ReLU())
        self.beside = nn.Linear(2 * local, 2 * local)
        self.second = perceptron([2 * local, 2 * local, settings.cloud])

    def forward(self, cloud: Tensor) -> Tensor:
        """Encode clouds (C, N, 6) of points (network units) and unit normals; return (C, cloud)."""
        each = self.first(cloud)
        return self.second(each + self.beside(each.amax(1))[:, None]).amax(1)


class Cvae(nn.Module):
    """Encoder q(z | grasp, cloud) and decoder p(grasp | z, cloud), prior N(0, I)."""

    def __init__(self, settings: NetworkSettings, tips: int = 3) -> None:
        super().__init__()
        grasp = 3 * tips + PALM
        cloud, hidden, latent = settings.cloud, settings.hidden, settings.latent
        self.cloud = CloudEncoder(settings)
        self.posterior = perceptron([cloud + grasp, *[hidden] * 3, 2 * latent], nn.SiLU)
        self.decoder = perceptron([cloud + latent, *[hidden] * 3, grasp], nn.SiLU)

    def forward(self, cloud: Tensor, grasp: Tensor, noise: Tensor) -> Output:
        """Encode and decode.

        Args:
            cloud: (C, N, 6).
            grasp: (C, G, 3 n + 9), G grasps of n tips on each cloud, centred like it.
            noise: (C, G, latent), standard normal.
        """
        feature = self.cloud(cloud)[:, None].expand(-1, grasp.shape[1], -1)
        mean, log_variance = self.posterior(torch.cat([feature, grasp], -1)).chunk(2, -1)
        log_variance = log_variance.clamp(-10.0, 4.0)
        latent = mean + noise * torch.exp(0.5 * log_variance)
        return Output(self.decode(feature, latent), mean, log_variance)

    def decode(self, feature: Tensor, latent: Tensor) -> Tensor:
        """Return grasps (..., 3 n + 9) of cloud features (..., cloud) and latents (..., latent)."""
        return self.decoder(torch.cat([feature, latent], -1))


class Losses(NamedTuple):
    """Loss and its parts, means over grasps; `fingertip_cm` is the mean distance of a fingertip."""

    total: Tensor
    fingertips: Tensor
    palm: Tensor
    rotation: Tensor
    kl: Tensor
    fingertip_cm: Tensor


def losses(output: Output, grasp: Tensor, kl_weight: float) -> Losses:
    """Return 2 L1(palm) + 0.2 |R R_hat^T - I|_F + 10 L1(fingertips) + w KL; L1 in metres, summed over coordinates."""
    difference = (output.grasp - grasp) / SCALE
    fingertips = difference[..., :-PALM].abs().sum(-1).mean()
    palm = difference[..., -PALM:-6].abs().sum(-1).mean()
    # |R R_hat^T - I|_F = |R - R_hat|_F, and 6 numbers say all of a rotation.
    off = rotation_of(output.grasp[..., -6:]) - rotation_of(grasp[..., -6:])
    rotation = off.square().sum((-1, -2)).add(1e-8).sqrt().mean()
    kl = 0.5 * (output.mean.square() + output.log_variance.exp() - 1.0 - output.log_variance).sum(-1).mean()
    total = 10.0 * fingertips + 2.0 * palm + 0.2 * rotation + kl_weight * kl
    tips = difference[..., :-PALM].unflatten(-1, (-1, 3)).norm(dim=-1).mean() * 100.0
    return Losses(total, fingertips, palm, rotation, kl, tips)


def rotation_of(six: Tensor) -> Tensor:
    """Return rotations (..., 3, 3) from their first two columns (..., 6) by Gram-Schmidt (Zhou et al. 2019)."""
    b = six[..., 3:]
    x = nn.functional.normalize(six[..., :3], dim=-1)
    y = nn.functional.normalize(b - (x * b).sum(-1, keepdim=True) * x, dim=-1)
    return torch.stack([x, y, torch.linalg.cross(x, y)], -1)
