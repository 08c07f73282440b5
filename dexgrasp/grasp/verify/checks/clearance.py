"""Clearances: of the true collision shapes, and of the covering spheres that the claim is made with."""

import numpy as np

from dexgrasp.grasp.verify.case import Case
from dexgrasp.grasp.verify.check import LENGTH, Check, at_least, at_most
from dexgrasp.grasp.verify.scene import Scene
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp_env.arrays import Array, Index

COVER_FAR = 0.02  # m: the claim counts nothing beyond
OPEN, BESIDE = 0.004, 0.001  # m between the open hand and the object, the table; and what stands around
_TRUE = 2e-5  # m, of MuJoCo's distances
_TABLE_FROM = 0.15  # m: nearer to the base than this the arm stands on its plinth, not over the table
_EDGE_ERROR = 0.0005  # m: how much the points of an edge may miss between two of them
_ALWAYS_APART = 0.003  # m: links that the joint ranges keep this far apart do not count in the claim


def clearance_checks(case: Case) -> list[Check]:
    """Check the grasp's clearances, tips apart, and the claim: no more than there is, and as the spheres have it.

    The claim is of object, table and the robot itself; neighbours are held to the same bound.
    """
    limits, found = case.limits, case.scene.clearances(case.record.q, tips_touch=True)
    bounds = {"hand_table": limits.off_table(case.top), "hand_seen": 0.0}
    checks = [
        at_least(f"clearance {kind}", value, bounds.get(kind, limits.clearance), "m", _TRUE)
        for kind, value in found.items()
    ]
    claimed = case.record.certificate.min_clearance_m
    if np.isnan(claimed):
        return checks
    found = {kind: value for kind, value in found.items() if kind not in ("hand_neighbour", "hand_seen")}
    counted = [value for kind, value in found.items() if kind != "self" or value < _ALWAYS_APART]
    return [
        *checks,
        at_most("min_clearance_m over the true one", claimed - min(counted), 0.0, "m", _TRUE),
        at_most("min_clearance_m as claimed", abs(claimed - cover_clearance(case)), LENGTH, "m"),
    ]


def pregrasp_checks(case: Case) -> list[Check]:
    """Check that the open hand, tips included, is clear; beside a low object it may stand as low as it grasps."""
    found, limits = case.scene.clearances(case.record.pregrasp, tips_touch=False), case.limits
    off_table = limits.off_table(case.top) if limits.is_low(case.top) else OPEN
    bounds = {
        "hand_object": OPEN,
        "hand_table": off_table,
        "self": 0.0,
        "hand_neighbour": BESIDE,
        "hand_seen": 0.0,
    }
    return [
        at_least(f"pregrasp clearance {kind}", value, bounds[kind], "m", _TRUE)
        for kind, value in found.items()
    ]


def cover_clearance(case: Case) -> float:
    """Return the least clearance of the covering spheres, m, frames and distances being the judge's own."""
    tree, scene, names = robot_tree(case.cell), case.scene, case.robot.bodies
    scene.place(case.record.q)
    R = np.array([scene.data.body(name).xmat.reshape(3, 3) for name in names])
    p = np.array([scene.data.body(name).xpos for name in names])
    body: Index = np.repeat(np.arange(len(names), dtype=np.int64), np.diff(tree.sphere_first))
    centres = np.einsum("sij,sj->si", R[body], tree.sphere_centre) + p[body]
    return min(
        COVER_FAR, _object(tree, body, centres, scene), _table(tree, body, centres), _self(tree, centres),
        _palm(tree, R, p),
    )  # fmt: skip


def _object(tree: RobotTree, body: Index, centres: Array, scene: Scene) -> float:
    counted = (body >= 2) & ~tree.sphere_is_tip
    return (scene.closest(centres[counted]).distances - tree.sphere_radius[counted]).min()


def _table(tree: RobotTree, body: Index, centres: Array) -> float:
    over = (body >= 2) & ~((centres[:, 0] < _TABLE_FROM) & (body < tree.base))
    return (centres[:, 2] - tree.sphere_radius)[over].min()


def _self(tree: RobotTree, centres: Array) -> float:
    first, least = tree.sphere_first, COVER_FAR
    for a, b in tree.pairs:
        one, two = slice(first[a], first[a + 1]), slice(first[b], first[b + 1])
        apart = np.linalg.norm(centres[one][:, None] - centres[two][None], axis=-1)
        apart = apart - tree.sphere_radius[one][:, None] - tree.sphere_radius[two][None]
        least = min(least, apart.min(initial=COVER_FAR))
    return least


def _palm(tree: RobotTree, R: Array, p: Array) -> float:
    """The link that works right beside the palm against the palm's box, edge by edge."""
    if tree.beside < 0:
        return COVER_FAR
    points = tree.beside_edges @ R[tree.beside].T + p[tree.beside]
    out = np.abs((points - p[tree.palm]) @ R[tree.palm] - tree.palm_box_centre) - tree.palm_box_half
    outside = np.linalg.norm(np.maximum(out, 0.0), axis=1)
    return np.where(outside > 0.0, outside, out.max(1)).min() - _EDGE_ERROR
