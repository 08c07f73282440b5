import numpy as np
import pytest
from oracles import cone_distance

from agents.physics.forces import holding_forces
from agents.physics.wrench import grasp_map
from dexgrasp_env.errors import InputError

POINTS = np.array([[0.03, 0, 0.05], [-0.03, 0.02, 0.05], [-0.03, -0.02, 0.05]])
NORMALS = np.array([[1.0, 0, 0], [-1, 0, 0], [-1, 0, 0]])
COM = np.array([0.0, 0, 0.05])
WEIGHT = 0.5 * 9.81


def fingers():
    J = np.zeros((3, 3, 4))
    J[0, 0, 0], J[1, 0, 1], J[2, 0, 2] = 0.08, 0.08, 0.08
    return J


def test_forces_balance_gravity_within_the_reduced_cones():
    answer = holding_forces(POINTS, NORMALS, 0.7, 0.5, COM + np.array([0, 0, 0.01]))
    assert answer.holds
    assert answer.reason == ""
    np.testing.assert_allclose(answer.forces.sum(0), [0, 0, WEIGHT], atol=1e-5)
    np.testing.assert_allclose(np.cross(POINTS - COM - [0, 0, 0.01], answer.forces).sum(0), 0, atol=1e-6)
    assert cone_distance(answer.forces, NORMALS, 0.7 / 1.5).max() == 0


def test_every_disturbance_is_answered_within_the_cones():
    forces = holding_forces(POINTS, NORMALS, 0.7, 0.5, COM, disturbance=0.5).forces
    G = grasp_map(POINTS, COM, 0.03)
    rng = np.random.default_rng(0)
    push = rng.normal(size=(500, 3))
    push *= 0.5 * WEIGHT / np.linalg.norm(push, axis=1, keepdims=True)
    for w in push:
        answered = forces - (np.linalg.pinv(G)[:, :3] @ w).reshape(3, 3)
        assert cone_distance(answered, NORMALS, 0.7 / 1.5).max() < 1e-9


def test_more_disturbance_needs_more_squeeze():
    presses = [
        -(holding_forces(POINTS, NORMALS, 0.7, 0.5, COM, disturbance=k).forces * NORMALS).sum()
        for k in (0, 0.5, 1.0)
    ]
    assert presses[0] < presses[1] < presses[2]


def test_torque_limits_bind_and_are_blamed():
    free = holding_forces(POINTS, NORMALS, 0.7, 0.5, COM, jacobians=fingers(), torque_limits=5.0)
    assert free.holds
    assert 0 < free.max_torque_fraction < 1
    tight = holding_forces(POINTS, NORMALS, 0.7, 0.5, COM, jacobians=fingers(), torque_limits=0.5)
    assert not tight.holds
    assert "squeeze" in tight.reason
    assert tight.max_torque_fraction <= 1 + 1e-9
    none = holding_forces(POINTS, NORMALS, 0.7, 0.5, COM, jacobians=fingers(), torque_limits=0.1)
    assert "balance gravity" in none.reason
    assert none.residual > 0.1


def test_reasons():
    one_face = holding_forces(POINTS, np.tile([0, 0, 1.0], (3, 1)), 0.7, 0.5, COM)
    assert "friction cones" in one_face.reason
    two = holding_forces(POINTS[:2] * [1, 0, 1], NORMALS[:2], 0.7, 0.5, COM)
    assert two.holds  # a pinch through the centre of mass answers any force on it
    offset = holding_forces(
        POINTS[:2] * [1, 0, 1] + [0, 0.01, 0.0], NORMALS[:2], 0.7, 0.5, COM, disturbance=0.0
    )
    assert not offset.holds


def test_bad_input():
    with pytest.raises(InputError, match="both"):
        holding_forces(POINTS, NORMALS, 0.7, 0.5, COM, jacobians=fingers())
    with pytest.raises(InputError, match="torque_limits"):
        holding_forces(POINTS, NORMALS, 0.7, 0.5, COM, jacobians=fingers(), torque_limits=[1.0, 2.0])
    with pytest.raises(InputError, match="safety"):
        holding_forces(POINTS, NORMALS, 0.7, 0.5, COM, safety=0.5)
    with pytest.raises(InputError, match="mass"):
        holding_forces(POINTS, NORMALS, 0.7, 0.0, COM)
