"""Checks of a robot's drives and bodies: each drive through its range, joints without limits, masses."""

from collections.abc import Iterator

import mujoco
import numpy as np

from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array
from dexgrasp_env.findings import Finding
from dexgrasp_env.robot.cell import Cell


def check_drives(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    """Yield what stops drives of the hand within their ranges, and which move nothing."""
    robot, (C, _) = cell.robot, cell.robot.drive
    drives, good = [j for j in np.flatnonzero(C.any(0)).tolist() if j >= robot.arm_dof], 0
    for j in drives:
        name, low_high = robot.joints[j], (robot.lower[j], robot.upper[j])
        ends = [_driven(home, C[:, j], end - home.qpos[j]) for end in low_high]
        if _moved(ends[0], ends[1], cell) < 0.001:  # m that something of the hand moves with a drive
            mend = "name it under `held`, or look at its axis and at what hangs on it"
            yield Finding("error", f"drive {name} moves nothing", mend)
            continue
        share = (ends[1].qpos[j] - ends[0].qpos[j]) / (low_high[1] - low_high[0])
        good += bool(share > 0.9)
        if share < 0.3:
            stopped = max(ends, key=lambda data: abs(data.ctrl[j] - data.qpos[j]))
            what = f"drive {name} goes through {100 * share:.0f} % of its range"
            yield Finding(
                "warning", f"{what}{_touched(stopped)}", "exclude pairs that overlap, or narrow the range"
            )
    yield Finding("info", f"{good} of {len(drives)} drives go through their ranges, the others open")


def _driven(home: mujoco.MjData, column: Array, way: float) -> mujoco.MjData:
    """Return the simulation after set-points went `way` along a column (n,) from home."""
    data = mujoco.MjData(home.model)
    data.qpos[:] = data.ctrl[:] = home.qpos
    ramp, settle = 200, 100  # physics steps
    for k in range(ramp + settle):
        data.ctrl[:] = home.qpos + min(1.0, (k + 1) / ramp) * way * column
        mujoco.mj_step(home.model, data)
    return data


def _moved(one: mujoco.MjData, other: mujoco.MjData, cell: Cell) -> float:
    """Return how far apart a shape of the hand is in two states, m, 10 mm from its middle as well: it may but turn."""
    bodies = [one.model.body(name).id for name in cell.robot.hand.bodies]
    own = np.isin(one.model.geom_bodyid, bodies)
    ends, others = (np.c_[data.geom_xpos, 0.01 * data.geom_xmat][own] for data in (one, other))
    return float(np.linalg.norm(ends - others, axis=1).max(initial=0.0))


def _touched(data: mujoco.MjData) -> str:
    """Return the pairs of bodies in contact as words."""
    name = data.model.body
    pairs = {tuple(sorted(name(b).name for b in data.model.geom_bodyid[c.geom])) for c in data.contact}
    return ": " * bool(pairs) + ", ".join(f"{a} touches {b}" for a, b in sorted(pairs)[:2])


def check_limits(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    """Yield the finger joints without limits of their own."""
    own, unit = cell.robot.hand.joints, robot_tree(cell).unit[cell.robot.hand_columns]
    wide = np.ptp(own.ranges, axis=0) / unit > 2.0 * np.pi - 0.05  # rad: a whole turn is no limit
    if found := [name for name, of in zip(own.names, wide, strict=True) if of]:
        yield Finding(
            "warning", f"joints without limits: {', '.join(found)}", "state `lower` and `upper`, the maker's"
        )
    else:
        yield Finding("info", "every joint of the hand has limits")


def check_masses(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    """Yield masses of the hand that are missing or that no hand has."""
    model, bodies = home.model, [home.model.body(name).id for name in cell.robot.hand.bodies]
    mass, least = model.body_mass[bodies], 1e-4  # kg: a lighter link has no mass
    missing = [name for name, m in zip(cell.robot.hand.bodies, mass, strict=True) if m < least]
    if missing:
        mend = "state masses in kg in the description: what has none cannot be simulated"
        yield Finding("warning", f"without mass: {', '.join(missing)}", mend)
    for body, m in zip(bodies, mass, strict=True):
        volume = _volume(model, body)
        if m >= least and volume > 0 and not 20.0 < m / volume < 25_000.0:  # foam, metal
            what = f"{model.body(body).name} of {1000 * m:.0f} g has {m / volume:.0f} kg/m3"
            yield Finding("warning", what, "look at the units of its mass (kg) and of its meshes (m)")
    mend = "look at the units: masses are kg, lengths m"
    good = 0.03 < mass.sum() < 6.0
    yield Finding("info" if good else "warning", f"the hand has {mass.sum():.2f} kg", "" if good else mend)


def _volume(model: mujoco.MjModel, body: int) -> float:
    """Return the volume of the boxes around what collides of a body, m3."""
    own = (model.geom_bodyid == body) & (model.geom_contype > 0)
    return float(np.prod(2.0 * model.geom_aabb[own, 3:], axis=1).sum())
