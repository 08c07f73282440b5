"""The closed form of `closure`: friction cones cut by the plane of three contacts, and whether they agree.

The kernels allocate nothing: they run millions of times a second.
"""

import numpy as np

from dexgrasp.mechanics.cones import tangent_basis
from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit


@njit
def _ratio(ga: float, gb: float, s: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Tighten (lo+, hi+, lo-, hi-): bounds of b for a = +1, and of -b for a = -1, by ga a + gb b >= 0."""
    lp, hp, lm, hm = s
    if gb > 0.0:
        r = -ga / gb
        return max(lp, r), hp, lm, min(hm, r)
    if gb < 0.0:
        r = -ga / gb
        return lp, min(hp, r), max(lm, r), hm
    if ga < 0.0:
        return np.inf, -np.inf, lm, hm
    if ga > 0.0:
        return lp, hp, np.inf, -np.inf
    return s


@njit
def _wedge(mu: float, T: Array, i: int, j: int, k: int, m: int) -> tuple[float, float, float, float]:
    """The wedge of one contact, of its chords T[i, j] and T[k, m], each (press, u, v) in its frame."""
    ma, mb = mu * T[i, j, 0], mu * T[k, m, 0]
    au, av, bu, bv = T[i, j, 1], T[i, j, 2], T[k, m, 1], T[k, m, 2]
    s = (-np.inf, np.inf, -np.inf, np.inf)
    s = _ratio(ma + au, mb + bu, s)
    s = _ratio(ma - au, mb - bu, s)
    s = _ratio(ma + av, mb + bv, s)
    return _ratio(ma - av, mb - bv, s)


@njit
def _meets(bl: float, bu: float, cl: float, cu: float, L: float, H: float) -> bool:
    """Return True where some b > 0 in [bl, bu] has [L b, H b] and [cl, cu] in common."""
    lo, hi = max(bl, 0.0), bu
    if not L <= H:
        return False
    if L > 0.0:
        hi = min(hi, cu / L)
    elif L == 0.0:
        if cu < 0.0:
            return False
    elif -np.inf < L:
        lo = max(lo, cu / L)
    if H < 0.0:
        hi = min(hi, cl / H)
    elif H == 0.0:
        if cl > 0.0:
            return False
    elif np.inf > H:
        lo = max(lo, cl / H)
    return hi > 0.0 and lo <= hi


@njit
def _box_meets(bl: float, bu: float, cl: float, cu: float, w: tuple[float, float, float, float]) -> bool:
    if bl > bu or cl > cu:
        return False
    return _meets(bl, bu, cl, cu, w[0], w[1]) or _meets(-bu, -bl, cl, cu, -w[3], -w[2])


@njit
def closed_form(mu: float, E: Array, T: Array, i: int, j: int, k: int) -> bool:
    """Return True where non-zero forces in the Eq. 2 cones of contacts i, j, k balance exactly.

    `E[i, j]` is p_j - p_i as (press, u, v) in frame i, and `T[i, j]` is `E[j, i]`: k runs fastest in both.
    """
    w1 = _wedge(mu, E, i, j, i, k)
    plus, minus = w1[0] <= w1[1], w1[2] <= w1[3]
    if not (plus or minus):
        return False
    w2 = _wedge(mu, E, j, i, j, k)
    plus, minus = plus and w2[0] <= w2[1], minus and w2[2] <= w2[3]
    if not (plus or minus):
        return False
    w3 = _wedge(mu, T, i, k, j, k)
    if plus and _box_meets(w1[0], w1[1], w2[0], w2[1], w3):
        return True
    return minus and _box_meets(-w1[3], -w1[2], -w2[3], -w2[2], w3)


@njit
def flatness(d12: float, d13: float, d23: float) -> float:
    """(height / longest side)^2 of a triangle of squared sides (Heron); 0 for coincident points."""
    longest = max(d12, max(d13, d23))
    if longest <= 0.0:
        return 0.0
    area = 2.0 * (d12 * d13 + d13 * d23 + d23 * d12) - d12 * d12 - d13 * d13 - d23 * d23
    return max(0.0, 0.25 * area) / (longest * longest)


def chord_tables(points: Array, normals: Array) -> tuple[Array, Array, Array]:
    """Return E[i, j], the chord p_j - p_i as (press, u, v) of contact i; T[i, j] = E[j, i]; D, squared distances."""
    x, y, z = np.moveaxis(points[None] - points[:, None], -1, 0)
    E = np.stack(
        [a[:, :1] * x + a[:, 1:2] * y + a[:, 2:] * z for a in (-normals, *tangent_basis(normals))], axis=-1
    )
    return E, np.ascontiguousarray(E.swapaxes(0, 1)), x * x + y * y + z * z
