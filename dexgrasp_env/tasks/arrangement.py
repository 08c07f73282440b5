"""Arrangements of clutter: neighbours drawn on the open table around the object, or dropped with it into a heap."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array, Mask
from dexgrasp_env.poses import rotate
from dexgrasp_env.scene.constants import CONTROL_STEPS, GRAVITY, TIMESTEP
from dexgrasp_env.tasks.constants import MAX_EPISODE_STEPS, NEIGHBOUR_MOVED, STILL
from dexgrasp_env.tasks.placement import Placement
from dexgrasp_env.tasks.records import TOUCHING_HAND
from dexgrasp_env.tasks.simulation import Simulation

_LOW, _HIGH = np.array([[0.30, 0.76], [-0.38, 0.38]]).T  # m, where what stands around the object may be
_HEADINGS, _TURNS = 30, 4  # ways outwards that are tried for a neighbour, and how often


@dataclass(frozen=True, kw_only=True)
class RestSettings:
    """Conditions under which a scene is at rest; chosen so that episodes without the robot keep their scene.

    Attributes:
        span: physics steps between two looks at whether all is still.
        spans: looks, at most, on the open table.
        creep: of poses, m and parts of a quaternion, in a span of a heap, whose contacts give a little for long.
        sink: m that an object may sink or float.
        pierce: m that two objects may pierce each other.
    """

    span: int = 250
    spans: int = 12
    creep: float = 7e-4
    sink: float = 0.003
    pierce: float = 0.002


@dataclass(frozen=True, kw_only=True)
class HeapSettings:
    """Settings of a heap: objects are dropped a few at a time under strong damping, as thrown ones roll apart.

    Attributes:
        sky: m, height at which objects wait for their turn, in free fall and far from all else.
        fall: m above the heap from which the next objects fall.
        layer: objects at a time.
        scatter: m off the middle at most of the first; times the root of how many lie.
        edge: m between where they are laid and where they may be.
        timestep: s, of a physics step meanwhile.
        calm_steps: physics steps between two reductions of all speeds.
        calm: factor of a reduction.
        layer_rounds: reductions while a layer falls.
        rest_rounds: reductions while all come to lie.
        pull: towards the middle, share of the weight.
        pull_width: m off the middle from which the pull is full.
        turns: times that what does not stay is laid again.
        spans: spans of rest that it has each time.
    """

    sky: float = 1000.0
    fall: float = 0.01
    layer: int = 3
    scatter: float = 0.025
    edge: float = 0.08
    timestep: float = 0.004
    calm_steps: int = 5
    calm: float = 0.8
    layer_rounds: int = 40
    rest_rounds: int = 60
    pull: float = 0.3
    pull_width: float = 0.1
    turns: int = 40
    spans: int = 4


_REST, _HEAP = RestSettings(), HeapSettings()


def set_out(
    simulation: Simulation, pose: Array, gaps: tuple[float, float] | None, rng: Generator
) -> Array | None:
    """Put the object at `pose` (7,) with its neighbours around it, or all of them in a heap about that place.

    A scene is accepted where all comes to rest on the table, free of the robot, and nothing pierces another by 2 mm or
    sinks by 3 mm; with gaps nothing floats, topples or slides by 3 mm.

    Args:
        simulation: the scene.
        pose: of the object, drawn or given.
        gaps: m, least and most between outlines; None: a heap.
        rng: of the draws.

    Returns:
        The poses (k, 7) that all would have at the end of an episode without the robot, as a heap creeps; None
        where the scene is not accepted.
    """
    if gaps is None:
        return _drop(simulation, pose, rng)
    around = _surround(simulation, pose, gaps, rng)
    if around is None:
        return None
    drawn = np.vstack([pose, *around])
    simulation.place(drawn)
    astray, poses = _come_to_rest(simulation, _REST.spans, STILL), simulation.poses()
    stays = not astray.any() and (np.abs(poses - drawn)[:, :3] <= _REST.sink).all()
    return poses if stays else None


# -- on the open table ------------------------------------------------------------------------------------------


def _surround(
    simulation: Simulation, pose: Array, gaps: tuple[float, float], rng: Generator
) -> list[Array] | None:
    """Draw poses (7,) of the neighbours, each slid outwards from the object until it is free; None where it is full."""
    standing = [outline(simulation.hull * simulation.variation.size, pose)]
    poses = []
    for model in simulation.neighbours:
        gap = rng.uniform(*gaps)
        own = Placement().sample(model, rng)
        own[:2] = pose[:2]
        shape = outline(model.solid.corners, own)
        free = _slide_out(shape, standing, gap, rng)
        if free is None:
            return None
        own[:2] += free
        standing.append(shape + free)
        poses.append(own)
    return poses


def _slide_out(shape: Array, standing: Sequence[Array], gap: float, rng: Generator) -> Array | None:
    """Return how far an outline slides, (2,) m, along a drawn way to the first place free of all that stands.

    Ways begin at the object; where none of these ends on the table, at whatever stands there.
    """
    begin = np.zeros((_HEADINGS, 2))
    for turn in range(_TURNS):
        angles = rng.uniform(-np.pi, np.pi, _HEADINGS)
        if turn:
            middles = np.array([other.mean(axis=0) for other in standing])
            begin = (middles - middles[0])[rng.integers(len(standing), size=_HEADINGS)]
        for angle, slid in zip(angles, begin, strict=True):
            free = _slide(shape, standing, gap, np.array([np.cos(angle), np.sin(angle)]), slid.copy())
            if free is not None:
                return free
    return None


def _slide(
    shape: Array, standing: Sequence[Array], gap: float, direction: Array, slid: Array
) -> Array | None:
    """Slide an outline along a direction from where it has `slid` to, (2,) m both; None where it leaves the table."""
    while _on_table(shape + slid).all():
        short = gap - nearest_gap(shape + slid, standing)
        if short <= 1e-4:  # m
            return slid
        slid += direction * short  # a gap grows by no more than what the outline moves
    return None


def _on_table(points: Array) -> Mask:
    return ((points >= _LOW) & (points <= _HIGH)).all(axis=-1)


def outline(corners: Array, pose: Array) -> Array:
    """Return the convex outline, from above, of a body's corners (V, 3) m at a pose (7,): (n, 2) m, anticlockwise."""
    from scipy.spatial import ConvexHull

    flat = (rotate(pose[3:], corners) + pose[:3])[:, :2]
    return flat[ConvexHull(flat).vertices]


def nearest_gap(shape: Array, others: Sequence[Array]) -> float:
    """Return the least of the gaps, m, between an outline and others; only those are measured that may be the least."""
    centre, reach = _circle(shape)
    bounds = [np.hypot(*(centre - other)) - reach - r for other, r in map(_circle, others)]
    least = np.inf
    for k in np.argsort(bounds):
        if bounds[k] >= least:
            break
        least = min(least, gap_between(shape, others[k]))
    return least


def _circle(shape: Array) -> tuple[Array, float]:
    """A circle around an outline: its centre (2,) m and radius m."""
    centre = shape.mean(axis=0)
    off = shape - centre
    return centre, float(np.sqrt((off * off).sum(axis=1).max()))


def gap_between(a: Array, b: Array) -> float:
    """Return the distance, m, between two outlines (n, 2) and (m, 2); minus how deep they overlap where they do."""
    apart = max(_beyond_edge(a, b), _beyond_edge(b, a))
    return apart if apart <= 0.0 else min(_to_edges(a, b), _to_edges(b, a))


def _beyond_edge(a: Array, b: Array) -> float:
    """Largest distance by which all of `b` lies outside of one edge of `a`; separating axes."""
    edges = np.roll(a, -1, axis=0) - a
    out = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    return float((out[:, None] * (b - a[:, None])).sum(-1).min(axis=1).max())


def _to_edges(a: Array, b: Array) -> float:
    """The least distance from a corner of `a` to an edge of `b`."""
    edges = np.roll(b, -1, axis=0) - b
    along = ((a[:, None] - b) * edges).sum(-1) / (edges * edges).sum(-1)
    nearest = b + np.clip(along, 0.0, 1.0)[..., None] * edges
    return float(np.linalg.norm(a[:, None] - nearest, axis=-1).min())


# -- in a heap ---------------------------------------------------------------------------------------------------


def _drop(simulation: Simulation, pose: Array, rng: Generator) -> Array | None:
    """Drop the object and its neighbours about its place, each onto what lies there; what does not stay there again.

    Returns:
        The poses (k, 7) at the end of an episode without the robot; None where they never come to rest.
    """
    count = 1 + len(simulation.neighbours)
    simulation.place(np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (count, 1)))
    astray, edge = np.ones(count, bool), _HEAP.scatter * np.sqrt(count) + _HEAP.edge
    centre = np.clip(pose[:2], _LOW + edge, _HIGH - edge)
    for _ in range(_HEAP.turns):
        _lay(simulation, astray, centre, rng)
        astray, poses = _strays(simulation)
        if not astray.any():
            return poses
    return None


def _lay(simulation: Simulation, which: Mask, centre: Array, rng: Generator) -> None:
    """Lay those of the objects (k,) down about `centre` (2,) m, turned at random, in a drawn order, some at a time."""
    data, dof, hulls = simulation.data, simulation.cell.robot.dof, _hulls(simulation)
    for k in np.flatnonzero(which).tolist():
        data.qpos[dof + 7 * k + 2], data.qvel[dof + 6 * k :][:6] = _HEAP.sky * (1.0 + k), 0.0
    lying, order = np.flatnonzero(~which).tolist(), rng.permutation(np.flatnonzero(which)).tolist()
    for first in range(0, len(order), _HEAP.layer):
        for k in order[first : first + _HEAP.layer]:
            spot, spin = rng.uniform(-1.0, 1.0, 2), rng.standard_normal(4)
            quat, poses = spin / np.sqrt((spin * spin).sum()), simulation.poses()
            top = max([0.0, *(highest(hulls[j], poses[j]) for j in lying)])
            own = np.array([*centre, top + _HEAP.fall, *quat])
            own[:2] += _HEAP.scatter * np.sqrt(1 + len(lying)) * spot
            own[2] -= rotate(quat, hulls[k])[:, 2].min()
            data.qpos[dof + 7 * k :][:7], data.qvel[dof + 6 * k :][:6] = own, 0.0
            lying.append(k)
        _calm(simulation, _HEAP.layer_rounds, which, centre)
    _calm(simulation, _HEAP.rest_rounds, np.zeros_like(which), centre)


def _calm(simulation: Simulation, steps: int, drawn: Mask, centre: Array) -> None:
    """Settle objects with strong damping, those of a mask (k,) pulled together about `centre` (2,) m."""
    model, data, dof = simulation.model, simulation.data, simulation.cell.robot.dof
    bodies = simulation.body + np.flatnonzero(drawn)
    weight = _HEAP.pull * GRAVITY * model.body_mass[bodies, None]
    model.opt.timestep = _HEAP.timestep
    for _ in range(steps):
        data.xfrc_applied[bodies, :2] = weight * np.clip(
            (centre - data.xpos[bodies, :2]) / _HEAP.pull_width, -1.0, 1.0
        )
        mujoco.mj_step(model, data, _HEAP.calm_steps)
        data.qvel[dof:] *= _HEAP.calm
    model.opt.timestep = TIMESTEP
    data.xfrc_applied[bodies] = 0.0


def _strays(simulation: Simulation) -> tuple[Mask, Array]:
    """Return which objects (k,) of a heap do not come to rest where they may, and all poses (k, 7) much later.

    That is as an episode ends in which the robot stays home, where all rest; the heap is then left as it begins.
    """
    astray, begin = _come_to_rest(simulation, _HEAP.spans, _REST.creep), simulation.poses()
    state, poses = simulation.get_state(), begin
    for _ in range(0 if astray.any() else MAX_EPISODE_STEPS * CONTROL_STEPS // _REST.span):
        simulation.settle(_REST.span)
        poses = simulation.poses()
        astray = np.linalg.norm(poses - begin, axis=1) > NEIGHBOUR_MOVED
        if astray.any():
            return astray, poses
    simulation.set_state(state)
    return astray, poses


def highest(corners: Array, pose: Array) -> float:
    """Return the height, m, of the highest of a body's corners (V, 3) at a pose (7,)."""
    return float(rotate(pose[3:], corners)[:, 2].max() + pose[2])


# -- at rest -----------------------------------------------------------------------------------------------------


def _come_to_rest(simulation: Simulation, spans: int, still: float) -> Mask:
    """Settle everything; return which objects (k,) move on by more than `still`, or are where none may be."""
    for _ in range(spans):
        before = simulation.poses()
        simulation.settle(_REST.span)
        moving = np.abs(simulation.poses() - before).max(axis=1) > still
        if not moving.any():
            break
    return moving | _misplaced(simulation)


def _misplaced(simulation: Simulation) -> Mask:
    """Return which objects (k,) are off the table, at the robot, sunk, or pierce another."""
    data, poses = simulation.data, simulation.poses()
    low = [rotate(p[3:], c)[:, 2].min() + p[2] for c, p in zip(_hulls(simulation), poses, strict=True)]
    touched = [data.sensordata[simulation.columns[TOUCHING_HAND]], *data.sensordata[simulation.touches]]
    deep = data.contact.geom[data.contact.dist < -_REST.pierce]
    pierced = np.isin(simulation.body + np.arange(len(poses)), simulation.model.geom_bodyid[deep])
    return (np.array(low) < -_REST.sink) | np.array(touched, bool) | pierced | ~_on_table(poses[:, :2])


def _hulls(simulation: Simulation) -> list[Array]:
    """Return the corners (V, 3) m of each object, in its own frame."""
    return [simulation.hull * simulation.variation.size, *(n.solid.corners for n in simulation.neighbours)]
