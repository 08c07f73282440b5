"""Postures that a robot file needs and an MJCF has not: a hand's open one, an arm's home; found by search."""

import copy
from itertools import combinations, pairwise, product
from typing import Any

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.model import bodies_apart, joints_between, posed, swept
from dexgrasp_env.robot.rebuilt import FLANGE
from dexgrasp_env.robot.robot import Arm, Hand

_LITTLE = 0.15  # rad that idle fingers may turn from straight, about


def open_posture(hand: Hand, model: mujoco.MjModel) -> list[float]:
    """Return the posture (h,) rad in which the tips of a grasp face each other best in front of the palm.

    Args:
        hand: whose limits, fingers and grasp count.
        model: of the hand alone, frames as here.
    """
    low, high = hand.joints.ranges
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, (20_000, len(low)))
    drawn = 0.5 * (low + high) + 0.5 * 0.85 * (high - low) * drawn  # the middle 85 % of each range
    _together(hand, drawn)
    best, free = _widest(hand, model, drawn)
    if not free:  # idle fingers that bend with the others may be in their way
        for finger in hand.fingers:
            if finger.aside and finger.name not in hand.grasp:
                drawn[:, [hand.joints.names.index(name) for name in finger.joints]] = finger.aside
        best, free = _widest(hand, model, drawn)
    if not free and not overlapping_links(model, best):  # else those that overlap are excluded first
        best, _ = _widest(hand, model, drawn, 2000)
    return np.clip(best.round(4), low, high).tolist()


def _widest(hand: Hand, model: mujoco.MjModel, drawn: Array, most: int = 200) -> tuple[Array, bool]:
    """Return the best of postures (k, h) rad in which nothing touches, and whether there is one; or the best of all.

    At most so many are tried.
    """
    (low, high), (C, c) = hand.joints.ranges, hand.free
    drawn = np.clip(drawn @ C.T + c, low, high)
    merits = _dexterity(hand, model, drawn) - 2.0 * _strain(drawn, low, high).mean(1)
    for k in np.argsort(-merits)[:most]:
        data = posed(model, drawn[k])
        mujoco.mj_forward(model, data)
        if not data.ncon:
            return drawn[k], True
    return drawn[np.argmax(merits)], False


def always_near(hand: Hand, model: mujoco.MjModel) -> tuple[tuple[str, str], ...]:
    """Return the pairs of bodies that stay so near each other in any posture that none can make them collide.

    So are links with two joints between them that are near in most: hulls fill what such links turn in. So are links of
    fingers that are in each other where all joints are at 0, as the maker drew them (MoveIt's "default" collisions).

    Args:
        hand: whose bodies and ranges count.
        model: of the hand alone, frames as here.
    """
    number = {name: model.body(name).id for name in hand.bodies}
    always = 0.01  # m within which bodies that need not collide always are
    pairs = [p for p in combinations(hand.bodies, 2) if model.body_parentid[number[p[1]]] != number[p[0]]]
    near = dict.fromkeys(pairs, always)
    # Links with two joints between them are counted where they touch: in half of the postures is too often.
    joined = {pair: 0 for pair in near if len(joints_between(model, *(number[name] for name in pair))) <= 2}
    count = 300
    drawn = np.random.default_rng(0).uniform(hand.joints.lower, hand.joints.upper, (count, model.nq))
    touching = 0.002  # m: bodies that never come so near need not be excluded
    for data in swept(model, drawn @ hand.free[0].T + hand.free[1]):
        for a, b in near.keys() | joined.keys():
            apart = bodies_apart(data, number[a], number[b], always)
            if (a, b) in joined:
                joined[a, b] += apart < touching
            if (a, b) in near:
                near[a, b] = min(apart, near[a, b])
                if not -0.004 < apart < always:  # m: deeper in each other they are no neighbours
                    del near[a, b]
    found = {pair for pair, least in near.items() if least < touching}
    found |= {pair for pair, often in joined.items() if often > 0.5 * count}
    if not hand.torsion:  # jaws may be drawn closed
        as_drawn = posed(model, np.clip(hand.free[1], *hand.joints.ranges))
        found |= {
            (a, b) for a, b in pairs if bodies_apart(as_drawn, number[a], number[b], always) < -touching
        }
    return tuple(sorted(found))


def put_aside(hand: Hand, model: mujoco.MjModel, open_at: list[float]) -> list[float]:
    """Return an open posture (h,) rad with idle fingers straight, and spread so far that they are in nobody's way.

    They spread alike, or in a fan: the farther from those that grasp, the more; else they turn a little from straight.
    Where none of it will do, they bend with the others.

    Args:
        hand: whose idle fingers state `aside`, straight but for a spread.
        model: of the hand alone, frames as here.
        open_at: (h,) rad, all fingers bent alike.
    """
    idle = [finger for finger in hand.fingers if finger.aside]
    wide, (low, high) = copy.copy(model), hand.joints.ranges
    wide.geom_margin[:] = 0.0022  # m: two are more than the 4 mm that an open hand keeps from itself
    bodies = {model.body(name).id for finger in idle for name in finger.bodies}
    still = bodies | {model.body(hand.palm).id}
    first = {model.body(finger.bodies[0]).id for finger in hand.fingers}
    straight, bent, fan = np.clip(0.0, low, high), np.array(open_at), np.zeros(len(low))
    spread, at = straight.copy(), posed(model, straight)
    for finger in idle:
        columns = [hand.joints.names.index(joint) for joint in finger.joints]
        bent[columns], spread[columns] = straight[columns], finger.aside
        bases = [at.body(other.bodies[0]).xpos for other in (finger, hand.finger(hand.grasp[-1]))]
        fan[columns] = np.linalg.norm(bases[0] - bases[1])
    ways = [
        share * (fan / fan.max()) ** fanned * (spread - straight)
        for share, fanned in product((1.0, 0.5, 0.25, 0.0), (0.0, 1.0) if idle else ())
    ]
    drawn = np.random.default_rng(0).normal(0.0, _LITTLE / 3.0, (500, len(low))) * (fan > 0.0)
    little = drawn[np.argsort(np.linalg.norm(drawn, axis=1))] if idle else drawn[:0]
    # As near as in a grasp is what fingers begin with; failing that, also what no grasp moves.
    for may, way in (*product([(first,)], (*ways, *little)), *product([(first, still)], ways)):
        q = np.clip(hand.free[0] @ np.clip(bent + way, low, high) + hand.free[1], low, high)
        data = posed(wide, q)
        mujoco.mj_collision(wide, data)
        near = [({*wide.geom_bodyid[contact.geom].tolist()}, contact.dist) for contact in data.contact]
        if all(not pair & bodies or (apart > 0.003 and any(map(pair.issubset, may))) for pair, apart in near):
            return q.round(6).tolist()
    return open_at


def overlapping_links(model: mujoco.MjModel, q: Array) -> tuple[tuple[str, str], ...]:
    """Return the pairs of bodies that touch at joints (h,) rad though two joints or fewer lie between them."""
    data = posed(model, q)
    mujoco.mj_forward(model, data)
    pairs = {tuple(sorted(model.geom_bodyid[contact.geom].tolist())) for contact in data.contact}
    near = [pair for pair in sorted(pairs) if len(joints_between(model, *pair)) <= 2]
    return tuple((model.body(a).name, model.body(b).name) for a, b in near)


def _together(hand: Hand, drawn: Array) -> None:
    """Bend all fingers but the opposing one alike, as far as they are alike."""
    names = hand.joints.names
    source = [names.index(name) for name in hand.finger(hand.grasp[1]).joints]
    for finger in hand.fingers:
        if finger.name != hand.grasp[0] and len(finger.joints) == len(source):
            drawn[:, [names.index(name) for name in finger.joints]] = drawn[:, source]


def _strain(q: Array, low: Array, high: Array) -> Array:
    """Return the nearness of each joint to the ends of its range: 0 at the middle, 1 at an end."""
    return ((q - 0.5 * (low + high)) / (0.5 * (high - low))) ** 2


def _dexterity(hand: Hand, model: mujoco.MjModel, drawn: Array) -> Array:
    """Return how well tips face each other in front of the palm in postures (k, h) rad."""
    sites = [model.site(hand.finger(name).tip).id for name in hand.grasp]
    tips, frames = np.empty((len(drawn), len(sites), 3)), np.empty((len(drawn), len(sites), 9))
    for k, data in enumerate(swept(model, drawn)):
        tips[k], frames[k] = data.site_xpos[sites], data.site_xmat[sites]
    between = tips[:, 1:].mean(1) - tips[:, 0]
    span = np.linalg.norm(between, axis=1)
    pads = (frames[..., 0::3] * (between / np.maximum(span, 1e-6)[:, None])[:, None]).sum(2)
    facing = pads[:, 0] - pads[:, 1:].mean(1)
    # Opposing tips 9 cm apart are best; 3 cm of a miss count as one.
    return (
        facing
        + frames[..., 2].min(1)
        - np.abs(span - 0.09) / 0.03
        - np.ptp(tips[..., 0], axis=1) / 0.03
        - 20.0 * (tips[..., 0].min(1) < 0.02)
    )


def home_posture(arm: Arm, model: mujoco.MjModel) -> tuple[list[float], bool]:
    """Return the posture (a,) rad with the flange over the table, looking down, that is farthest from its limits.

    Of a short arm the flange is nearer to the base. Without one, the middle of the ranges; whether there is one is
    returned beside it.

    Args:
        arm: whose limits count.
        model: of the arm alone, frames as here.
    """
    data = mujoco.MjData(model)
    low, high = arm.joints.ranges
    low, high = np.maximum(low, -np.pi) + 0.05, np.minimum(high, np.pi) - 0.05  # rad from the limits
    for goal in ((0.4, 0.0, 0.55), (0.25, 0.0, 0.4)):  # m: where the flange is
        best, found = -np.inf, 0.5 * (low + high)
        for start in np.random.default_rng(0).uniform(low, high, (300, len(low))):
            q = _flange_down(arm, data, start, (low, high), np.array(goal))
            if q is not None and (merit := _room(arm, data) - _strain(q, low, high).max()) > best:
                best, found = merit, q
        if np.isfinite(best):
            break
    return found.round(4).tolist(), bool(np.isfinite(best))


def _flange_down(arm: Arm, data: mujoco.MjData, q: Array, limits: Any, flange: Array) -> Array | None:
    """Return where damped least squares lead from `q` with the flange (3,) m as a goal, None where that is not it."""
    model = data.model
    body, J = model.body(arm.bodies[-1]).id, np.zeros((6, model.nv))
    goal = flange + np.array([0.0, 0.0, FLANGE])
    for _ in range(60):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        z = data.xmat[body].reshape(3, 3)[:, 2]
        error = np.r_[goal - data.xpos[body], np.cross(z, [0.0, 0.0, -1.0])]
        if np.linalg.norm(error) < 1e-4 and z[2] < 0:
            return q
        mujoco.mj_jacBody(model, data, J[:3], J[3:], body)
        q = np.clip(q + J.T @ np.linalg.solve(J @ J.T + 1e-3 * np.eye(6), error), *limits)
    return None


def _room(arm: Arm, data: mujoco.MjData) -> float:
    """Return the score of a home posture: height of the lowest joint, dexterity, straightness; much less on contact."""
    model = data.model
    mujoco.mj_forward(model, data)
    places = np.array([data.body(name).xpos for name in arm.bodies[2:]])
    J = np.zeros((6, model.nv))
    mujoco.mj_jacBody(model, data, J[:3], J[3:], model.body(arm.bodies[-1]).id)
    freedom = np.linalg.svd(J)[1][-1]
    aside = 2.0 * np.abs(places[:, 1]).max()
    last, along = data.body(arm.bodies[-1]), FLANGE + np.array([0.05, 0.12, 0.2])  # m, of a hand
    hand = last.xpos + np.outer(along, last.xmat.reshape(3, 3)[:, 2])
    links = np.concatenate([np.linspace(*ends, 5) for ends in pairwise(places[:-2])])
    blocked = data.ncon or np.linalg.norm(links[:, None] - hand, axis=2).min() < 0.15  # m
    return min(places[:, 2].min(), 0.4) + 5.0 * freedom - aside - 10.0 * bool(blocked)
