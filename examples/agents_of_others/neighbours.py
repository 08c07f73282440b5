"""A stand-in for what Contact-GraspNet needs of `torch-cluster`, where that is not to be had: one cloud, no batches."""

import numpy as np
import torch
from scipy.spatial import cKDTree


def fps(x: torch.Tensor, batch: torch.Tensor, ratio: float, *more: object) -> torch.Tensor:
    """Return the indices of points (N, 3) that lie farthest apart, a share of them; the first is drawn (batch_size)."""
    left, chosen = torch.full((len(x),), torch.inf), [int(torch.randint(len(x), (1,)))]
    for _ in range(int(np.ceil(float(ratio) * len(x) - 1e-6)) - 1):
        left = torch.minimum(left, ((x - x[chosen[-1]]) ** 2).sum(1))
        chosen.append(int(left.argmax()))
    return torch.tensor(chosen)


def radius(
    x: torch.Tensor,
    y: torch.Tensor,
    r: float,
    batch_x: object,
    batch_y: object,
    most: int,
    *more: object,
) -> torch.Tensor:
    """Return pairs (2, K) of points of `y` and of `x` nearer than r, at most so many of each, drawn (batch_size)."""
    order = torch.randperm(len(x))
    near = torch.cdist(y, x[order]) < r
    row, column = (near & (near.cumsum(1) <= most)).nonzero(as_tuple=True)
    return torch.stack([row, order[column]])


def knn(x: torch.Tensor, y: torch.Tensor, k: int, *more: object) -> torch.Tensor:
    """Return pairs (2, K) of points of `y` and the k nearest of `x` (batch_size)."""
    nearest = cKDTree(x.numpy()).query(y.numpy(), k=k)[1].reshape(len(y), -1)
    return torch.stack(
        [torch.arange(len(y)).repeat_interleave(nearest.shape[1]), torch.from_numpy(nearest.ravel())]
    )


graclus_cluster = grid_cluster = knn_graph = None  # torch-geometric imports them; the network uses none
