"""Two soft contacts to five: margin, squeeze, load and capacity against the judge's own programmes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tables import table

from dexgrasp.grasp.verify.checks.forces import least_way
from dexgrasp.grasp.verify.cones import conic_margin, largest_push, slides, wrench_map
from dexgrasp.mechanics.contact_models import contact_model
from dexgrasp.mechanics.contacts import Contacts, shape_of
from dexgrasp.mechanics.internal_force import firmest_squeeze
from dexgrasp.mechanics.margin import UNDEFINED, cone_margin, margins
from dexgrasp.mechanics.strength import capacity_of, hold_residual, load_of, torque_fraction
from dexgrasp_env.arrays import cube_directions

KINDS = table("tip_kinds")
MU, PRESS = 0.6, 2.5


def _grasp(rng, count):
    """Contacts around a ball, evenly but for chance, with normals a little off."""
    angles = 2 * np.pi * (np.arange(count) + rng.uniform(-0.1, 0.1, count)) / count
    out = np.stack([np.cos(angles), np.sin(angles), rng.uniform(-0.15, 0.15, count)], 1)
    normals = out + rng.normal(0, 0.08, out.shape)
    return 0.035 * out, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _contacts(rng, count, torsion, shared=False):
    points, normals = _grasp(rng, count)
    parts, joints = 4 if torsion else 3, 1 if shared else 4
    J = np.zeros((count, parts, joints * (1 if shared else count)))
    for i in range(count):
        own = slice(0, 1) if shared else slice(joints * i, joints * (i + 1))
        J[i, :, own] = rng.normal(0, 0.05, (parts, joints))
        if shared:  # a slide that all contacts close with
            J[i, :3, 0], J[i, 3:] = -normals[i], 0.0
    limit = 20.0 if shared else 0.7
    return Contacts(
        points, normals, J, np.full(J.shape[2], limit), np.full(count, MU), np.array([0.004, -0.002, 0.003]),
        np.array([0.0, 0.0, -2.5]), contact_model(torsion),
    )  # fmt: skip


@pytest.mark.parametrize(("count", "torsion"), KINDS)
def test_margins_are_the_judges_and_have_slopes(count, torsion):
    rng, step = np.random.default_rng(count), 1e-6
    if torsion:  # contacts at one point are of no rank
        at_one = np.ones((count, 3)), _grasp(rng, count)[1]
        assert cone_margin(*at_one, MU, shape_of(count, contact_model(torsion)))[0] == UNDEFINED
    for _ in range(6):
        points, normals = _grasp(rng, count)
        model = contact_model(torsion)
        shape = shape_of(count, model)
        value, by_points, by_normals, forces = cone_margin(points, normals, MU, shape)
        assert value == margins(points[None], normals[None], MU, model)[0]
        assert value == pytest.approx(conic_margin(points, normals, MU, torsion), abs=2e-6)
        G = wrench_map(points, points.mean(0), normals, torsion)
        assert_allclose(G @ forces.ravel(), 0.0, atol=1e-8)
        assert slides(forces, normals)[0].sum() == pytest.approx(1.0)

        def moved(p, n, model=model):
            n = n / np.linalg.norm(n, axis=1, keepdims=True)
            return margins(p[None], n[None], MU, model)[0]

        way = rng.normal(size=points.shape)
        slope = (moved(points + step * way, normals) - moved(points - step * way, normals)) / (2 * step)
        assert slope == pytest.approx((by_points * way).sum(), rel=2e-3, abs=1e-2)
        slope = (moved(points, normals + step * way) - moved(points, normals - step * way)) / (2 * step)
        assert slope == pytest.approx((by_normals * way).sum(), rel=2e-3, abs=1e-4)


@pytest.mark.parametrize(
    ("count", "torsion", "shared"), [(*kind, False) for kind in KINDS] + [(2, 0.008, True)]
)
def test_squeeze_load_and_capacity_are_the_judges(count, torsion, shared):
    rng = np.random.default_rng(10 * count)
    for _ in range(3):
        contacts = _contacts(rng, count, torsion, shared)
        weight = contacts.weight
        squeeze = firmest_squeeze(contacts, PRESS, 10.0)
        assert squeeze.share == 1.0
        press, sliding = slides(squeeze.forces, contacts.normals)
        assert press.min() > PRESS - 1e-6
        assert (sliding <= MU * press + 1e-6).all()
        assert torque_fraction(contacts, squeeze.forces) <= 1.0 + 1e-9
        assert hold_residual(contacts, squeeze.forces) < 1e-6
        G = wrench_map(contacts.points, contacts.centre, contacts.normals, torsion)
        answer = -weight * np.linalg.pinv(G)[:, :3]
        way = least_way(squeeze.forces, answer, contacts.normals, MU)
        assert load_of(contacts, squeeze.forces) == pytest.approx(1.0 + way, rel=1e-3)
        assert squeeze.push == pytest.approx(way, rel=2e-3)
        stiff = load_of(contacts, squeeze.forces, np.full(contacts.torque_limits.shape, 10.0))
        assert 1.0 <= stiff <= 1.0 + way + 1e-3
        torques = contacts.jacobians.transpose(2, 0, 1).reshape(len(contacts.torque_limits), -1)
        torques = torques / contacts.torque_limits[:, None]
        down = weight * np.array([0, 0, -1.0, 0, 0, 0])
        most = [
            largest_push(G, contacts.normals, MU, torques, (down, weight * np.r_[way, np.zeros(3)]))
            for way in cube_directions()
        ]
        assert capacity_of(contacts) == pytest.approx(1.0 + min(most), rel=2e-3)
