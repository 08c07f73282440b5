"""Execution: paths that are free, timing within the limits, scripts that fit the episode."""

import mujoco
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from robots import CELL, HOME, LOWER, ROBOT, UPPER, VELOCITY

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.grasp.grasp import GraspMotion
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame, solve_palm
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.motion.approach import plan_arm
from dexgrasp.motion.collision import CollisionChecker, densify
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.script import make_script
from dexgrasp.motion.time_optimal import fastest_squared_speeds, places_at
from dexgrasp.motion.timing import time_path, within_limits
from dexgrasp_env.robot.model import compiled_robot, posed
from dexgrasp_env.scene.constants import CONTROL_PERIOD


def box(x, y, size):
    mesh = trimesh.creation.box(size)
    mesh.apply_translation([x, y, size[2] / 2])
    return ConvexDistance.from_points(mesh.vertices)


def palm_down(x, y, z, yaw=0.78):
    fingers = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    down = np.array([0.0, 0.0, -1.0])
    q = HOME.copy()
    R = np.stack([down, np.cross(fingers, down), fingers], axis=1)
    assert solve_palm(q, R, np.array([x, y, z]), robot_tree(CELL), 300, 1e-5) < 1e-4
    return q


TOWER = box(0.5, 0.0, (0.04, 0.09, 0.45))
LEFT, RIGHT = palm_down(0.45, -0.25, 0.2), palm_down(0.45, 0.25, 0.2)


def test_home_is_free_and_inside_the_table_is_not():
    checker = CollisionChecker(CELL, None)
    assert checker.free(HOME)
    low = HOME.copy()
    low[[1, 3]] = 1.4, -1.0
    contact = checker.first_contact(np.stack([HOME, low]))
    assert contact is not None
    assert contact.bodies[1] == "table"


def test_start_within_the_margin_can_be_left_but_deep_contact_cannot():
    checker = CollisionChecker(CELL, TOWER, margin=0.5)
    assert not checker.free(LEFT)
    checker.allow(LEFT)
    assert checker.free(LEFT)
    inside = palm_down(0.45, 0.0, 0.2)
    checker.allow(inside)
    assert not checker.free(inside)


def _deepest(model, q):
    data = posed(model, q)
    mujoco.mj_collision(model, data)
    return -data.contact.dist.min(initial=0.0)


def test_bodies_of_a_moving_hand_are_kept_apart_by_their_shapes():
    model, margin, free, left = compiled_robot(CELL), 0.002, 0, 0
    for q in ROBOT.drawn(20):
        q[: len(ROBOT.arm.bodies) - 1] = HOME[: len(ROBOT.arm.bodies) - 1]
        checker, path = CollisionChecker(CELL, None, margin), np.stack([HOME, q])
        contact = checker.first_contact(path)
        if contact is None:
            free += 1
            assert max(_deepest(model, row) for row in densify(path, 0.01)) == 0.0
        else:
            assert contact.clearance < margin
        near, deep = not checker.free(q), _deepest(model, q)
        checker.allow(q)
        assert checker.free(q) or deep > 0.005
        left += near and checker.free(q)
    assert 2 < free < 18
    assert left


def test_straight_way_through_the_tower_is_avoided_the_same_way_twice():
    checker = CollisionChecker(CELL, TOWER)
    assert not checker.free(LEFT, RIGHT)
    path = plan_arm(checker, LEFT, RIGHT)
    assert path is not None
    assert checker.first_contact(path) is None
    assert_array_equal(path, plan_arm(checker, LEFT, RIGHT))
    assert_array_equal(path[[0, -1]], [LEFT, RIGHT])


def test_pregrasp_inside_the_object_is_reported_with_the_bodies():
    inside = palm_down(0.45, 0.0, 0.2)
    with pytest.raises(NoPath, match=r"approach_blocked: .* mm from object") as caught:
        make_script(LEFT, GraspMotion(inside, inside, inside), TOWER, CELL)
    assert caught.value.reason == "approach_blocked"


def test_lift_beyond_reach_is_reported():
    high = palm_down(0.5, 0.0, 0.7)
    with pytest.raises(NoPath, match="lift_out_of_reach"):
        make_script(HOME, GraspMotion(high, high, high), None, CELL)


@pytest.mark.parametrize("speed", [0.3, 0.65, 1.0])
def test_timing_keeps_velocity_and_acceleration_limits(speed):
    goal, middle = (
        np.clip(HOME + np.linspace(*ends, 23), LOWER, UPPER) for ends in ((-0.6, 0.8), (0.5, -0.5))
    )
    way = [HOME, middle, *np.linspace(goal - 0.05, goal, 15)]
    samples = time_path(way, robot_tree(CELL), speed=speed)
    assert_allclose(samples[-1], goal, atol=1e-12)
    rate = np.diff(np.concatenate([HOME[None], samples]), axis=0) / CONTROL_PERIOD
    assert 0.9 < np.max(np.abs(rate) / VELOCITY) / speed < 1.02
    change = np.diff(np.concatenate([0 * rate[:1], rate, 0 * rate[:1]]), axis=0) / CONTROL_PERIOD
    assert (np.abs(change) <= 1.1 * speed * ROBOT.acceleration).all()


def test_script_phases_limits_and_actions():
    q = palm_down(0.5, 0.1, 0.25)
    grasp, squeeze = q.copy(), q.copy()
    grasp[[8, 12, 21]] += 0.2
    squeeze[[8, 12, 21]] += 0.25
    script = make_script(HOME, GraspMotion(q, grasp, squeeze), box(0.5, 0.1, (0.03, 0.03, 0.1)), CELL)
    assert list(script.phases) == ["approach", "close", "squeeze", "lift", "hold"]
    assert len(script.targets) * CONTROL_PERIOD < 9.0
    assert within_limits(HOME, script.targets, robot_tree(CELL))
    assert len(script.phases["hold"]) * CONTROL_PERIOD >= 3.2
    assert_allclose(script.way("lift")[0], squeeze)
    rise = palm_frame(script.targets[-1], robot_tree(CELL))[1] - palm_frame(squeeze, robot_tree(CELL))[1]
    assert_allclose(rise, [0, 0, 0.14], atol=1e-4)
    assert_array_equal(script.way("approach")[0], HOME)
    assert_array_equal(script.at(10_000), script.targets[-1])


def test_speed_along_a_straight_line_is_that_of_the_triangle_or_trapezium():
    """One joint from rest to rest: bang-bang, with a plateau where the velocity limit cuts it off."""
    at = np.linspace(0.0, 2.0, 201)
    first, second = np.ones((201, 1)), np.zeros((201, 1))
    free = fastest_squared_speeds(at, first, second, np.array([10.0]), np.array([4.0]))
    assert np.allclose(free, 8.0 * np.minimum(at, 2.0 - at), atol=1e-6)
    cut = fastest_squared_speeds(at, first, second, np.array([1.5]), np.array([4.0]))
    assert np.allclose(cut, np.minimum(8.0 * np.minimum(at, 2.0 - at), 2.25), atol=1e-6)
    assert len(places_at(at, free, 0.1)) == np.ceil(2.0 * np.sqrt(2.0 / 4.0) / 0.1)
