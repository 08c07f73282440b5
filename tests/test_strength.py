"""Load and capacity of a grasp against brute force and against another solver."""

import numpy as np
import pytest

from dexgrasp.mechanics.contacts import Contacts
from dexgrasp.mechanics.equilibrium import grasp_map, rms_radius
from dexgrasp.mechanics.strength import capacity_of, hold_residual, load_of

MU = 0.6


def contacts(mass=0.2, limit=0.7, turn=0.0):
    """Three contacts around a cylinder of 6 cm, each finger with its own three joints of 8 cm lever."""
    angle = np.array([0.0, 2.2, -2.2]) + turn
    normals = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    jacobians = np.zeros((3, 3, 9))
    for i in range(3):
        jacobians[i, :, 3 * i : 3 * i + 3] = 0.08 * np.eye(3)
    points = 0.03 * normals + np.array([0.5, 0.0, 0.05])
    gravity = np.array([0.0, 0.0, -9.81 * mass])
    centre = np.array([0.5, 0.0, 0.05])
    return Contacts(points, normals, jacobians, np.full(9, limit), np.full(3, MU), centre, gravity)


def grasp_matrix(c):
    return grasp_map(c.points, c.centre, rms_radius(c.points))


def pressing(c, press):
    squeeze = -press * c.normals
    G = grasp_matrix(c)
    wrench = np.r_[0, 0, c.weight, 0, 0, 0] - G @ squeeze.ravel()
    return squeeze + (np.linalg.pinv(G) @ wrench).reshape(3, 3)


def bears(c, forces, answer, load):
    """Whether forces stay in their cones under pushes up to a load, answered as `answer` (9, 3) says."""
    pushes = np.random.default_rng(0).normal(size=(20000, 3))
    pushes /= np.linalg.norm(pushes, axis=1, keepdims=True)
    size = (load - 1.0) * c.weight
    after = forces - size * np.einsum("ij,kj->ki", answer, pushes).reshape(-1, 3, 3)
    press = -(after * c.normals).sum(-1)
    return (np.linalg.norm(after + press[..., None] * c.normals, axis=-1) <= MU * press + 1e-9).all()


def test_forces_that_fall_short_have_the_share_they_bear():
    c = contacts()
    whole, part = pressing(c, 5.0), pressing(contacts(mass=0.12), 5.0)
    assert load_of(c, part) == pytest.approx(0.6, abs=1e-9)
    assert hold_residual(c, part) == pytest.approx(0.4, abs=1e-9)
    assert load_of(c, -5.0 * c.normals) == 0.0  # bears nothing
    assert load_of(c, pressing(c, 0.1)) == 0.0  # out of the cones
    assert load_of(c._replace(torque_limits=np.full(9, 0.2)), whole) == 0.0  # beyond the joints
    assert load_of(c, whole + 0.5 * np.eye(3)) == 0.0  # unbalanced


def test_capacity_below_one_is_the_share_of_gravity_that_can_be_borne():
    c = contacts(mass=6.0)
    share = capacity_of(c)
    assert 0.0 < share < 1.0
    assert capacity_of(contacts(mass=6.0 * share * 0.999)) > 1.0


def test_joints_whose_set_points_stand_still_answer_with_the_least_energy():
    c, stiffness = contacts(), np.repeat([20.0, 4.0, 4.0], 3)  # the stiff finger answers most of a push
    forces, G = pressing(c, 5.0), grasp_matrix(c)
    give = np.diag(0.08**2 / stiffness + 1e-6)
    system = np.block([[give, G.T], [G, np.zeros((6, 6))]])
    answer = np.linalg.solve(system, np.r_[np.zeros((9, 3)), np.eye(6, 3)])[:9]
    load = load_of(c, forces, stiffness)
    assert 1.5 < load < load_of(c, forces) - 0.01
    assert bears(c, forces, answer, load - 1e-9)
    assert not bears(c, forces, answer, 1.0 + 1.002 * (load - 1.0))
    assert load_of(c, forces, np.full(9, 7.0)) == pytest.approx(load_of(c, forces), rel=1e-3)
