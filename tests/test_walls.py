"""The walls of hollow things: what was seen of a bowl is open above, and a bowl wider than the hand is held by them."""

import numpy as np

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.geometry.walls import LOW, walls_of
from dexgrasp.grasp.thresholds import FROZEN
from dexgrasp.planning.planner import Planner

WALL = 0.004  # m


def bowl(radius=0.12, height=0.08, foot=0.04, count=1200, middle=(0.5, 0.0)):
    """Return points (N, 3) m of both sides of a bowl's wall, a quarter of an ellipse, and of its floor."""
    rng = np.random.default_rng(3)
    rise, turn = rng.uniform(0.0, np.pi / 2.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    out = foot + (radius - foot) * np.sin(rise) - WALL * (rng.random(count) < 0.5)
    up = np.maximum(height * (1.0 - np.cos(rise)), 0.002)
    wall = np.stack([out * np.cos(turn), out * np.sin(turn), up], axis=1)
    far = foot * np.sqrt(rng.random(count // 8))
    turned = turn[: len(far)]
    floor = np.stack([far * np.cos(turned), far * np.sin(turned), np.full(len(far), WALL)], axis=1)
    return np.concatenate([wall, floor]) + np.array([*middle, 0.0])


def target(points, mass=0.25, hollow=True):
    hull = GraspTarget.of_corners([np.concatenate([points, points * [1.0, 1.0, 0.0]])], mass=mass)
    return GraspTarget(hull.distance, hull.centre, hull.mass, seen=points if hollow else None)


def test_fingers_may_go_inside_a_bowl_but_not_into_its_wall():
    whole = target(bowl())
    walls = whole.opened()
    inside, in_wall, above = [0.5, 0.0, 0.06], [0.5 + 0.116, 0.0, 0.07], [0.5, 0.0, 0.10]
    assert (whole.distance.distance([inside, in_wall]) < 0.0).all()
    assert walls.distance.distance([inside])[0] > 0.03
    assert walls.distance.distance([in_wall])[0] < 0.0
    assert walls.distance.distance([above])[0] > 0.03
    assert walls.mass == whole.mass
    guessed = target(bowl(), mass=None).opened()
    assert guessed.known_mass is None
    assert np.linalg.norm(walls.centre[:2] - [0.5, 0.0]) < 0.005


def test_no_fingertip_gets_through_what_is_closed_above():
    rng = np.random.default_rng(0)
    turn, up, far = rng.uniform(0.0, 2.0 * np.pi, 600), rng.uniform(0.0, 0.1, 600), np.full(600, 0.04)
    up[:200], far[:200] = 0.1, 0.04 * np.sqrt(rng.random(200))
    can = np.stack([far * np.cos(turn), far * np.sin(turn), up], axis=1)
    union = ConvexDistance.union([ConvexDistance.from_points(part) for part in walls_of(can)])
    way = np.stack([*(rng.uniform(-0.025, 0.025, (2, 500))), np.full(500, 0.09)], axis=1)
    assert union.distance(way).max() < FROZEN.tip_radius


def test_what_is_low_or_holds_no_air_has_no_walls():
    assert walls_of(bowl(height=0.9 * LOW)) == []
    assert target(bowl(), hollow=False).opened() is None


def test_a_bowl_wider_than_the_hand_is_held_by_its_wall():
    """Thumb and fingers press on both sides of the wall, which no grasp of the hull can."""
    points = bowl()
    planner = Planner()
    assert planner.plan(target(points, hollow=False)).grasp is None
    found = planner.plan(target(points))
    assert found.grasp is not None
    out = found.grasp.contacts[:, :2] - [0.5, 0.0]
    outwards = (found.grasp.normals[:, :2] * out).sum(1)
    assert (outwards > 0.0).any()
    assert (outwards < 0.0).any()
