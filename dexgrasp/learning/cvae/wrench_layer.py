"""Eq. 4, the lower level of the bilevel optimisation, as a differentiable layer: batched, double precision, CPU.

Section 2.1 of the supplement builds the bilevel optimisation on OptNet (Amos and Kolter, 2017); this is that layer, for
learning through the lower level. The planner needs no layer: by the envelope theorem the gradients of a margin are
those of its Lagrangian (`dexgrasp.mechanics.margin`), without torch.

The forces of Eq. 4 are not unique: `regulariser` |f|^2 makes them so, and gradients are of the regularised solution.
DAQP finds the active constraints; torch solves and differentiates their KKT system, to any order. Where a constraint is
active with a zero multiplier the derivative does not exist, and a one-sided one is returned.
"""

import numpy as np

from dexgrasp.mechanics.cones import C1, C2, POLE, C
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch
    from torch import Tensor


def _active(H: Tensor, A: Tensor, b: Tensor) -> Tensor:
    """Return 1 for the active constraints (B, m) at the minimum of 0.5 f^T H f subject to A f >= b, 0 for others.

    Batches are H (B, n, n), A (B, m, n), b (B, m).
    """
    import daqp

    found = A.new_zeros(b.shape)
    for k, (H_k, A_k, b_k) in enumerate(zip(*(t.detach().numpy() for t in (H, A, b)), strict=True)):
        above, sense = np.full(len(b_k), 1e30), np.zeros(len(b_k), np.int32)
        _, _, flag, info = daqp.solve(
            np.ascontiguousarray(H_k), np.zeros(len(H_k)), A_k, above, b_k, sense, primal_tol=1e-12
        )
        if flag < 1:
            raise RuntimeError(f"the QP was not solved: DAQP's exit flag is {flag}")
        found[k] = torch.from_numpy(np.asarray(info["lam"]) < 0.0)
    return found


def _forces(H: Tensor, A: Tensor, b: Tensor) -> Tensor:
    """Return argmin 0.5 f^T H f subject to A f >= b, (B, n), from the KKT system of the active constraints."""
    active, n = _active(H, A, b), H.shape[-1]
    rows = A * active[..., None]
    above, below = torch.cat([H, -rows.mT], -1), torch.cat([rows, torch.diag_embed(1.0 - active)], -1)
    known = torch.cat([H.new_zeros(len(H), n), active * b], -1)
    return torch.linalg.solve(torch.cat([above, below], -2), known)[:, :n]


def tangent_basis(normals: Tensor) -> tuple[Tensor, Tensor]:
    """Return tangents (..., 3) of unit normals (..., 3): the basis of `dexgrasp.mechanics.cones`, differentiable."""
    axis, first, second = (normals.new_tensor(v) for v in (C, C1, C2))
    D = 1.0 + (normals * axis).sum(-1, keepdim=True)
    pole = D < POLE
    safe = torch.where(pole, torch.ones_like(D), D)
    t1, t2 = (v - (normals * v).sum(-1, keepdim=True) / safe * (axis + normals) for v in (first, second))
    return torch.where(pole, first, t1), torch.where(pole, -second, t2)


def grasp_matrix(points: Tensor, length: float) -> Tensor:
    """Return grasp maps (B, 6, 3 N) of points (B, N, 3) m about their centroids, torques divided by a length, m."""
    arms = ((points - points.mean(1, keepdim=True)) / length)[..., None, :]
    eye = torch.eye(3, dtype=points.dtype).expand(*points.shape, 3)
    cross = torch.linalg.cross(arms, eye).mT
    return torch.cat([eye, cross], -2).permute(0, 2, 1, 3).flatten(2)


def pyramid_matrix(normals: Tensor, mu: Tensor) -> Tensor:
    """Return rows (B, 5 N, 3 N) of f_min and Eq. 2: normal, +t1, -t1, +t2, -t2; normals (B, N, 3), mu (B,)."""
    B, N, _ = normals.shape
    t1, t2 = tangent_basis(normals)
    friction = -mu[:, None, None] * normals
    rows = torch.stack([-normals, friction + t1, friction - t1, friction + t2, friction - t2], 2)
    spread = torch.eye(N, dtype=normals.dtype)
    return (spread[None, :, None, :, None] * rows[:, :, :, None, :]).reshape(B, 5 * N, 3 * N)


def wrench_layer(
    points: Tensor,
    normals: Tensor,
    mu: Tensor | float,
    regulariser: float = 1e-3,
) -> tuple[Tensor, Tensor]:
    """Solve Eq. 4 with `regulariser` |f|^2 added, differentiably; L is 5 cm, normal forces are at least 1 N.

    Args:
        points: (B, N, 3) m.
        normals: (B, N, 3) unit vectors out of the object.
        mu: friction coefficients (B,), or one.
        regulariser: above 0; smaller is nearer to Eq. 4, with steeper gradients.

    Returns:
        forces (B, N, 3) [N] and residual (B,), |F|^2 + |tau / L|^2 of those forces; both float64.

    Raises:
        InputError: for shapes that do not fit, numbers that are not finite, or out of range.
    """
    if points.ndim != 3 or points.shape[-1] != 3 or normals.shape != points.shape:
        raise InputError(
            f"points and normals must have shape (B, N, 3), got {tuple(points.shape)}, {tuple(normals.shape)}"
        )
    points, normals = points.double(), normals.double()
    mu = torch.as_tensor(mu, dtype=torch.float64).expand(len(points))
    if not (torch.isfinite(points).all() and torch.isfinite(normals).all()):
        raise InputError("points and normals must be finite")
    if not ((mu > 0).all() and regulariser > 0):
        raise InputError("mu and regulariser must be above 0")
    G = grasp_matrix(points, 0.05)
    A = pyramid_matrix(normals, mu)
    H = 2.0 * (G.mT @ G + regulariser * torch.eye(G.shape[-1], dtype=torch.float64))
    b = A.new_zeros(A.shape[:2])
    b[:, ::5] = 1.0  # N
    f = _forces(H, A, b)
    wrench = (G @ f[..., None])[..., 0]
    return f.unflatten(-1, (-1, 3)), (wrench**2).sum(-1)
