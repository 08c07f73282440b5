import numpy as np
import pytest

from dexgrasp.mechanics.contacts import Contacts
from dexgrasp.mechanics.equilibrium import grasp_map
from dexgrasp.mechanics.internal_force import RESERVED, firmest_squeeze
from dexgrasp.mechanics.strength import load_of

POINTS = np.array([[0.03, 0, 0.05], [-0.03, 0.02, 0.05], [-0.03, -0.02, 0.05]])
NORMALS = np.array([[1.0, 0, 0], [-1, 0, 0], [-1, 0, 0]])
COM = np.array([0.0, 0, 0.05])
MU, MASS = 0.5, 0.3


def random_grasp(rng):
    """Contacts on opposite sides of a body of some width, turned and moved at random."""
    points = POINTS + rng.normal(size=(3, 3)) * 0.01
    normals = NORMALS + rng.normal(size=(3, 3)) * 0.2
    J = np.zeros((3, 3, 12))
    for i in range(3):
        J[i, :, 4 * i : 4 * i + 4] = 0.06 * rng.normal(size=(3, 4))
    return (
        points,
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        J,
        COM + rng.normal(size=3) * 0.01,
    )


def touching_planes(normals, count):
    """Inward normals (3, count, 3) of planes that touch the cones of MU, made without the package's tangents."""
    a = np.cross(normals, normals[:, [1, 2, 0]] + [0.3, -0.2, 0.5])
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(normals, a)
    turn = 2 * np.pi * np.arange(count) / count
    planes = -MU * normals[:, None] + np.cos(turn)[:, None] * a[:, None] + np.sin(turn)[:, None] * b[:, None]
    return planes / np.sqrt(1 + MU * MU)


def contacts(points, normals, J, centre=COM, mass=MASS, limit=0.7, mu=MU):
    """Contacts of an object in the hand."""
    limits, gravity = np.full(J.shape[2], limit), np.array([0.0, 0.0, -9.81 * mass])
    return Contacts(points, normals, J, limits, np.full(3, mu), centre, gravity)


def highs(points, normals, J, centre, limit, mass=MASS, count=150):
    """The largest D by a linear programme in all nine forces, with the cones as `count` planes each."""
    from scipy.optimize import linprog

    G, weight = grasp_map(points, centre, 0.03), 9.81 * mass
    B = np.linalg.pinv(G)[:, :3].reshape(3, 3, 3)
    rows, bound = [], []
    for i, planes in enumerate(touching_planes(normals, count)):
        for a in planes:
            row = np.zeros(10)
            row[3 * i : 3 * i + 3], row[9] = -a, weight * np.linalg.norm(B[i].T @ a)
            rows.append(row)
            bound.append(0.0)
        for j in range(J.shape[2]):
            answer = weight * np.linalg.norm(B[i].T @ J[i, :, j])
            for sign in (1.0, -1.0):
                for share, free in ((0.0, 0.0), (1.0, RESERVED)):  # as it holds; as it answers a larger push
                    row = np.zeros(10)
                    row[3 * i : 3 * i + 3], row[9] = sign * J[i, :, j], share * answer
                    rows.append(row)
                    bound.append(limit + free * answer)
    equal = np.c_[G, np.zeros(6)]
    answer = linprog(
        np.r_[np.zeros(9), -1.0], np.array(rows), bound, equal, np.r_[0, 0, weight, 0, 0, 0],
        bounds=[(None, None)] * 9 + [(None, 10.0)],
    )  # fmt: skip
    return answer.x[9] if answer.status == 0 else None


@pytest.mark.parametrize(("mass", "count"), [(MASS, 10), (0.1 * MASS, 6)])
def test_the_firmest_squeeze_is_the_linear_programmes(mass, count):
    rng, compared = np.random.default_rng(0), 0
    for _ in range(count):
        points, normals, J, centre = random_grasp(rng)
        best = highs(points, normals, J, centre, 0.7, mass)
        grasp = contacts(points, normals, J, centre, mass)
        mine = firmest_squeeze(grasp)
        if best is None or best < 0.0:
            assert mine.push == 0.0
            assert mine.share < 1.0
            continue
        compared += 1
        assert mine.share == 1.0
        assert mine.load == pytest.approx(load_of(grasp, mine.forces), abs=1e-4)
        assert mine.push == pytest.approx(best, rel=2e-3, abs=2e-3)
    assert compared > 3
