"""Plan the slide of an object too flat to be pinched over the table's edge, and the pinch there.

There the table is one of the things that stand around the object, and the floor is the table: the planner of a cell
whose table is lower plans the grasp, and its certificate says that the hand keeps clear of the real one.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import islice

import numpy as np
from numpy.random import Generator

from dexgrasp.geometry.target import GraspTarget
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.slide import Push, Slide, can_push, make_slide, tips_apart
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.proposals import SurfaceProposals
from dexgrasp.planning.result import PlanResult
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Array, grid
from dexgrasp_env.scene.constants import TABLE_CENTRE_X, TABLE_SIZE

_INSIDE = 0.016  # m inside the edge that the centre of mass stays
_ALIKE = 0.001  # m by which one tip may touch before the other: what is pushed turns until both do
_BORNE, _FIRM = 1.0, 2.0  # weights: of a grasp worth a push, and that ends the search for one
_FLOOR = 0.5  # m below the table
_HALF = 0.5 * np.array(TABLE_SIZE[:2])
_MIDDLE = np.array([TABLE_CENTRE_X, 0.0])


def plan_slide(planner: Planner, target: GraspTarget, seed: int, start: Array) -> Slide | None:
    """Return the push after which something flat can be grasped; None where there is none, or it is not flat.

    Args:
        planner: of the cell.
        target: the object, seen all round, with nothing around it.
        seed: of the proposals.
        start: (n,) rad, set-points now.
    """
    guessed = target.uncertainty is not None or target.neighbours
    if guessed or not planner.settings.is_low(target.top) or not can_push(planner.cell):
        return None
    slides = list(islice(_slides(start, target, planner), 8))  # pushes that the arm can make
    in_brief = _best(slides, target, _at_edge(planner, patience=0), seed, _FIRM)
    return in_brief or _best(slides, target, _at_edge(planner), seed, _BORNE)


def _best(slides: list[Slide], target: GraspTarget, there: Planner, seed: int, enough: float) -> Slide | None:
    """Return the first slide after which a grasp bears `enough`, else the most; None where none bears its weight."""
    best, most = None, _BORNE
    for slide in slides:
        push = slide.push
        load = _load(there.plan(slid(target, push.distance * push.direction), seed, there.tree.home.copy()))
        if load >= most:
            best, most = slide, load
        if load >= enough:
            break
    return best


def _slides(start: Array, target: GraspTarget, planner: Planner) -> Iterator[Slide]:
    """Yield the pushes that the arm can make, best first, but none nearly in the direction of another."""
    made = list[Array]()
    for push in pushes(target, tips_apart(planner.cell), planner.settings.tip_radius):
        if all(push.direction @ other < np.cos(np.deg2rad(10.0)) for other in made):
            with suppress(NoPath):
                yield make_slide(push, start, target, planner.cell)
                made.append(push.direction)


def plan_slid(planner: Planner, target: GraspTarget, slide: Slide, seed: int, start: Array) -> PlanResult:
    """Return the plan for an object where a push has taken it.

    Args:
        planner: of the cell.
        target: the object as it lay before.
        slide: that is done.
        seed: of the proposals.
        start: (n,) rad, set-points now.
    """
    there, plans = slid(target, slide.moved * slide.push.direction), list[PlanResult]()
    for k in range(4):  # seeds
        plans.append(_at_edge(planner).plan(there, seed + k, start))
        if _load(plans[-1]) >= _FIRM:
            break
    return max(plans, key=_load)


def _load(plan: PlanResult) -> float:
    return -1.0 if plan.grasp is None else plan.grasp.certificate.load


def slid(target: GraspTarget, shift: Array) -> GraspTarget:
    """Return the object, moved by (2,) m, with the table as its neighbour and the floor as z = 0."""
    by = [*shift, _FLOOR]
    level = zip(_MIDDLE - _HALF, _MIDDLE + _HALF, strict=True)
    # The table is taken to be 2 mm lower than it is: the object lies on it.
    table = grid(*level, (_FLOOR - TABLE_SIZE[2], _FLOOR - 0.002))
    moved = GraspTarget.of_corners(
        [part + by for part in target.distance.corners], target.mass, target.centre + by
    )
    return replace(moved, neighbours=((table,),))


def pushes(target: GraspTarget, apart: float, tip: float) -> list[Push]:
    """Return pushes that leave an object sticking out over an edge, and still lying; the best first.

    Args:
        target: the object.
        apart: m, of the two tips.
        tip: m, their radius.
    """
    from scipy.spatial import ConvexHull

    points = target.corners[:, :2]
    outline = points[ConvexHull(points).vertices]
    centre, found = target.centre[:2], []
    for direction, (one, between, other) in zip(*_touches(target, apart, tip), strict=True):
        # A side may stand out 5.5 mm between them: at a corner what is pushed turns away.
        if not (abs(one - other) <= _ALIKE and one - between <= 0.0055):
            continue
        touch = centre + min(one, other) * direction
        for out in map(np.array, ((-1.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -1.0))):  # of the table
            distance = _distance(outline, centre, direction, out)
            if distance is None:
                continue
            there = centre + distance * direction
            if (np.abs(there - _MIDDLE) <= _HALF - 0.99 * _INSIDE).all():
                before_base = out[0] < 0.0 and abs(there[1]) < 0.1
                # m: prices of a grasp in front of the base, and beyond the far edge, which the arm hardly reaches.
                price = 0.1 * before_base + 0.35 * (out[0] > 0.0)
                found.append((distance + price, Push(direction, distance, touch)))
    return [push for _, push in sorted(found, key=lambda item: item[0])]


def _touches(target: GraspTarget, apart: float, tip: float) -> tuple[Array, Array]:
    """Return level directions (D, 2), and where along them, m from the centre, tips on the table touch (D, 3).

    The first and the last are the two that push, the second one between them; nan where one touches nothing.
    """
    turns = np.deg2rad(np.arange(0.0, 360.0, 1.5))
    directions = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    across = np.stack([-directions[:, 1], directions[:, 0]], axis=1)
    beside = target.centre[:2] + apart * np.array([0.5, 0.0, -0.5])[:, None] * across[:, None]
    way = np.full(beside.shape[:2], -np.linalg.norm(np.ptp(target.corners, axis=0)))
    for _ in range(30):  # until a tip touches
        tips = np.insert(beside + way[..., None] * directions[:, None], 2, tip, axis=2)
        off = target.distance.distance(tips).reshape(way.shape) - tip
        way += off
    return directions, np.where(np.abs(off) < _ALIKE, way, np.nan)


def _at_edge(planner: Planner, patience: int = 2) -> Planner:
    cell = replace(planner.cell, name="edge", table_height=planner.cell.table_height - _FLOOR)
    # Most points are over the table, and of no use.
    more = replace(planner.settings, surface_points=600, triples=100, postures=120)
    return Planner(replace(more, patience=patience, firm_load=_FIRM), _Overhanging(), cell)


class _Overhanging(SurfaceProposals):
    """Of an even sample, only as many places above as there are elsewhere: over the table nothing opposes them."""

    def places(self, target: GraspTarget, settings: PlannerSettings, rng: Generator) -> tuple[Array, Array]:
        """Return points (P, 3) m and outward normals (P, 3) of a sample, places above as many as others."""
        points, normals = super().places(target, settings, rng)
        above = normals[:, 2] > 0.2
        kept = ~above | (np.cumsum(above) <= np.sum(~above))
        return points[kept], normals[kept]


def _distance(outline: Array, centre: Array, direction: Array, out: Array) -> float | None:
    """Return how far, m, to push along a direction for as much as is wanted to stick out; None where that falls."""
    towards = direction @ out
    if towards < 0.6:  # cosine of the way to the edge
        return None
    edge = _MIDDLE @ out + np.abs(_HALF @ out)
    reach = (outline @ out).max()
    most = (edge - _INSIDE - centre @ out) / towards
    distance = min((edge + 0.065 - reach) / towards, most)  # m that are to stick out
    sticks_out = reach + distance * towards - edge
    return distance if 0.0 < distance < 0.56 and sticks_out > 0.022 else None  # m
