"""Limits, timing and collisions of an exported trajectory, from the rows alone.

The limits are the makers' tables, typed again: a wrong number in the exporter's is not confirmed by itself.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from dexgrasp.export.read import Recording, Rows
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.active import active_cell
from dexgrasp_env.robot.cell import SIMULATED

SHARE = 0.95
"""Largest share of a limit that a trajectory may use."""
_ARM: dict[str, tuple[float, ...]] = {
    "lower": (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    "upper": (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    "velocity": (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    "acceleration": (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),
    "jerk": (7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0),
}
_HAND: dict[str, tuple[float, ...]] = {
    "lower": (-0.47, -0.196, -0.174, -0.227) * 3 + (0.263, -0.105, -0.189, -0.162),
    "upper": (0.47, 1.61, 1.709, 1.618) * 3 + (1.396, 1.163, 1.644, 1.719),
    "velocity": (7.0,) * 16,
    "acceleration": (60.0,) * 16,
    "jerk": (3000.0,) * 16,
}
_PERIODS = {"arm": 0.001, "hand": 0.003}  # s: the arm takes 1 kHz, the hand 333 Hz
_TIME = 1e-9  # s
_STEP = 0.02  # s between states that are looked at for collisions
_CLEAR = -1e-4  # m: deeper than this is a collision
_FAR = 0.05  # m: distances beyond are not measured
_OBJECT = "object"  # what the geoms of the object are called, with a number


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at: its value, the bound, and whether it holds."""

    name: str
    value: float
    bound: str
    holds: bool


def check_trajectory(recording: Recording, mount: str = "palm_normal") -> list[Finding]:
    """Check everything that can be known of a trajectory before a robot moves; all findings must hold."""
    arm, hand = (_in_cell(part, limits) for part, limits in (("arm", _ARM), ("hand", _HAND)))
    return [
        _same_cell(recording), *_timing("arm", recording.arm), *_timing("hand", recording.hand), _same_end(recording),
        *_limits("arm", recording.arm, arm), *_limits("hand", recording.hand, hand),
        *_collisions(recording, mount),
    ]  # fmt: skip


def _timing(name: str, rows: Rows) -> list[Finding]:
    period = _PERIODS[name]
    off = float(np.abs(rows.times - period * np.arange(len(rows.times))).max())
    return [
        Finding(
            f"{name}: times are multiples of {1000 * period:g} ms from 0, off by (s)",
            off,
            f"<= {_TIME:g}",
            off <= _TIME,
        )
    ]


def _same_end(recording: Recording) -> Finding:
    gap = float(abs(recording.arm.times[-1] - recording.hand.times[-1]))
    bound = _PERIODS["hand"] + _TIME
    return Finding("arm and hand end together, apart by (s)", gap, f"<= {_PERIODS['hand']:g}", gap <= bound)


def _same_cell(recording: Recording) -> Finding:
    own, planned = active_cell().stamp, str(recording.facts.get("cell", SIMULATED))
    return Finding("cell: of another one", float(own != planned), f"this is {own}", own == planned)


def _in_cell(part: str, maker: dict[str, tuple[float, ...]]) -> dict[str, tuple[float, ...]]:
    """The tighter of the maker's limits and the cell's."""
    own = getattr(active_cell().robot, part).joints
    return {
        name: tuple(
            (max if name == "lower" else min)(pair) for pair in zip(limits, getattr(own, name), strict=True)
        )
        for name, limits in maker.items()
    }


def _limits(name: str, rows: Rows, limits: dict[str, tuple[float, ...]]) -> list[Finding]:
    q, period = rows.positions, _PERIODS[name]
    room = float(np.minimum(q - np.array(limits["lower"]), np.array(limits["upper"]) - q).min())
    findings = [Finding(f"{name}: inside the joint limits by (rad)", room, ">= 0", room >= 0.0)]
    # At rest before the first row and after the last: a jump at either end is motion too.
    still = np.concatenate([np.repeat(q[:1], 3, axis=0), q, np.repeat(q[-1:], 3, axis=0)])
    for order, quantity in enumerate(("velocity", "acceleration", "jerk"), start=1):
        change = np.abs(np.diff(still, n=order, axis=0)) / period**order
        used = float((change / np.array(limits[quantity])).max())
        findings.append(
            Finding(f"{name}: share of the {quantity} limits", used, f"<= {SHARE}", used <= SHARE)
        )
    return findings


def _collisions(recording: Recording, mount: str) -> list[Finding]:
    """Distances of the true collision shapes: robot to itself and to the table, and to the object while approaching."""
    import mujoco

    model, data = _model(mount, _parts(recording.facts))
    states, approaching = _states(recording)
    pairs = _pairs(model)
    least = dict.fromkeys(pairs, _FAR)
    from_to = np.zeros(6)
    for q, before_contact in zip(states, approaching, strict=True):
        data.qpos[:23] = q
        mujoco.mj_kinematics(model, data)
        for kind, members in pairs.items():
            if kind == "object" and not before_contact:
                continue
            for a, b in members:
                least[kind] = min(least[kind], mujoco.mj_geomDistance(model, data, a, b, _FAR, from_to))
    words = {
        "self": "robot to itself",
        "table": "robot to the table",
        "object": "robot to the object on the approach",
    }
    return [
        Finding(f"{words[kind]} (m)", least[kind], ">= 0", least[kind] >= _CLEAR)
        for kind, found in pairs.items()
        if found
    ]


def _parts(facts: dict[str, Any]) -> list[Array]:
    """Vertices of the object's convex parts, which the hull holds one after the other; none where senseless."""
    try:
        hull = np.asarray(facts.get("hull"), dtype=float)
        sizes = np.asarray(facts.get("part_sizes") or [len(hull)], dtype=int)
    except (TypeError, ValueError, OverflowError):
        return []
    if hull.ndim != 2 or hull.shape[1:] != (3,) or not np.isfinite(hull).all():
        return []
    if sizes.ndim != 1 or sizes.min() < 4 or sizes.sum() != len(hull):
        return []
    return np.split(hull, np.cumsum(sizes)[:-1])


def _model(mount: str, parts: list[Array]) -> tuple[Any, Any]:
    import mujoco

    from dexgrasp_env.robot.model import robot_spec

    spec = robot_spec(mount)
    spec.body("panda_link0").pos = [0, 0, 0]  # the files are in its frame
    top = [0, 0, active_cell().table_height]
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=top)
    for k, part in enumerate(parts):
        mesh = spec.add_mesh(name=f"{_OBJECT}{k}", uservert=part.ravel())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        spec.worldbody.add_geom(
            name=f"{_OBJECT}{k}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"{_OBJECT}{k}"
        )
    model = spec.compile()
    return model, mujoco.MjData(model)


def _states(recording: Recording) -> tuple[Array, list[bool]]:
    """Every 20 ms a state (23,), and whether the approach still lasts."""
    arm, hand = recording.arm, recording.hand
    times = np.arange(0.0, arm.times[-1] + _STEP, _STEP)
    q = [np.interp(times, rows.times, column) for rows in (arm, hand) for column in rows.positions.T]
    end = arm.times[-1]
    for segment in recording.facts.get("segments") or []:
        if (
            isinstance(segment, dict)
            and segment.get("name") == "approach"
            and isinstance(segment.get("end"), int | float)
        ):
            end = float(segment["end"])
    return np.stack(q, axis=1), [bool(t <= end) for t in times]


def _pairs(model: Any) -> dict[str, list[tuple[int, int]]]:
    """Geom pairs by what they are of; those that MuJoCo would not collide are left out."""
    names = {g: model.geom(g).name for g in range(model.ngeom)}
    own = [
        g for g in range(model.ngeom) if model.geom_contype[g] and not names[g].startswith(("table", _OBJECT))
    ]
    moving = [g for g in own if model.body_weldid[model.geom_bodyid[g]] != 0]
    far = [g for g in moving if not names[g].startswith(("panda_link1", "panda_link2"))]
    table, target = model.geom("table").id, [g for g, name in names.items() if name.startswith(_OBJECT)]
    excluded = {frozenset((int(s) >> 16, int(s) & 0xFFFF)) for s in model.exclude_signature}
    return {
        "self": [pair for pair in combinations(own, 2) if _may_collide(model, *pair, excluded)],
        "table": [(g, table) for g in far],
        "object": [(g, t) for g in moving for t in target],
    }


def _may_collide(model: Any, a: int, b: int, excluded: set[frozenset[int]]) -> bool:
    one, two = (int(model.body_weldid[model.geom_bodyid[g]]) for g in (a, b))
    parents = (
        int(model.body_weldid[model.body_parentid[one]]),
        int(model.body_weldid[model.body_parentid[two]]),
    )
    bodies = frozenset((int(model.geom_bodyid[a]), int(model.geom_bodyid[b])))
    return one != two and one != parents[1] and two != parents[0] and bodies not in excluded
