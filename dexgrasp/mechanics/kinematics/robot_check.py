"""A robot tested before anything is planned with it: the faults of users' files, each with its mend."""

import copy
from collections.abc import Iterator
from functools import lru_cache
from itertools import product

import mujoco
import numpy as np

from dexgrasp.mechanics.kinematics.drive_check import check_drives, check_limits, check_masses
from dexgrasp.mechanics.kinematics.forward import body_frames, fingertips
from dexgrasp.mechanics.kinematics.palm_ik import PALM_DOWN, reach_palm
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array
from dexgrasp_env.findings import Finding
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.poses import about_z
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.model import compiled_robot, excluded_pairs, joints_between, robot_spec, swept
from dexgrasp_env.robot.robot import Finger
from dexgrasp_env.scene.arena import read_arena

_OFF = 0.004  # m that a tip's surface may be from its sphere
_PALMS = tuple(product((0.4, 0.5, 0.6), (-0.2, 0.0, 0.2), np.linspace(-np.pi, np.pi, 6, endpoint=False)))
"""x and y, m, and yaw, rad, of those poses."""


def check_robot(cell: Cell) -> list[Finding]:
    """Return what is found of a cell's robot: errors have to be mended, warnings looked at."""
    checks = (
        _kinematics, _excluded, _authority, check_drives, check_limits, check_masses, _tips, _opposition, _meeting,
        _bearing, _reach,
    )  # fmt: skip
    compiled_robot(cell)  # refuses what no simulation can tell anything of
    model = _alone(cell)
    found = list(_order(cell, model))
    if any(finding.level == "error" for finding in found):
        return found  # nothing else can be told of joints that are others
    home = _at(model, cell.robot.home)
    found += _home(cell, home)
    if any(finding.level == "error" for finding in found):
        return found  # what touches already moves by itself: all else would follow from it
    return found + [finding for check in checks for finding in check(cell, home)]


def score(findings: list[Finding]) -> int:
    """Return the share of checks that found nothing, per cent; a warning counts as half of a fault."""
    weight = {"info": 1.0, "warning": 0.5, "error": 0.0}
    return round(100 * sum(weight[finding.level] for finding in findings) / max(1, len(findings)))


def _finding(good: bool, what: str, mend: str, level: str = "error") -> Finding:
    """Report of something that it is good, or how to mend it."""
    return Finding("info", what) if good else Finding(level, what, mend)


def _pad(data: mujoco.MjData, finger: Finger) -> Array:
    """The direction (3,) that the pad of a finger faces, world frame."""
    return data.body(finger.bodies[-1]).xmat.reshape(3, 3) @ finger.pad


def _alone(cell: Cell, excluding: bool = True) -> mujoco.MjModel:
    spec = robot_spec(cell)
    spec.option = read_arena().option
    for exclude in [] if excluding else list(spec.excludes):
        spec.delete(exclude)
    return with_decimal_points(spec.compile)


def _at(model: mujoco.MjModel, q: Array) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = data.ctrl[:] = q
    mujoco.mj_forward(model, data)
    return data


def _order(cell: Cell, model: mujoco.MjModel) -> Iterator[Finding]:
    robot = cell.robot
    for what, found in (
        ("joints", [model.joint(j).name for j in range(model.njnt)]),
        ("actuators", [model.actuator(a).name for a in range(model.nu)]),
    ):
        if found == list(robot.joints):
            yield Finding("info", f"{len(found)} {what} in the order of the file")
        else:
            yield Finding("error", f"{what} are {', '.join(found)}", f"name these: {', '.join(robot.joints)}")


def _kinematics(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    worst, ids = 0.0, [home.model.body(name).id for name in cell.robot.bodies]
    for q in cell.robot.drawn(50):
        data, (R, p) = _at(home.model, q), body_frames(q, robot_tree(cell))
        turned = np.abs(R.reshape(-1, 9) - data.xmat[ids]).max()
        worst = max(worst, turned, np.abs(p - data.xpos[ids]).max())
    mend = "joints have to sit at their bodies' origins, and to turn or slide"
    yield _finding(worst < 1e-12, f"kinematics and simulation differ by {worst:.0e}", mend)


def _home(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    touching = {
        " and ".join(sorted(home.model.body(body).name for body in pair)) for pair, _ in _touching(home)
    }
    mend = "change `open` of the hand, or exclude the pair"
    found = [Finding("error", f"{pair} touch with the hand open", mend) for pair in sorted(touching)]
    yield from found or [Finding("info", "nothing touches with the arm at home and the hand open")]


def _excluded(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    """Bodies that are excluded from colliding, though motion takes them into each other.

    With two joints between them or fewer, bodies overlap in every hand.
    """
    model = home.model
    pairs = {pair for pair in excluded_pairs(model) if len(joints_between(model, *pair)) > 2}
    if not pairs:
        return
    every, robot, found = _alone(cell, excluding=False), cell.robot, dict[frozenset[int], float]()
    resting = {pair for pair, _ in _touching(_at(every, robot.home))}
    for q in robot.drawn(300):
        for pair, depth in _touching(_at(every, q)):
            if pair in pairs - resting:
                found[pair] = max(found.get(pair, 0.0), depth)
    for pair, depth in found.items():
        if depth > _OFF:
            both = " and ".join(model.body(body).name for body in sorted(pair))
            deep = f"{both} get {1000 * depth:.0f} mm into each other: they are excluded from colliding"
            yield Finding("warning", deep, "take the <exclude> out of the MJCF")


def _touching(data: mujoco.MjData) -> Iterator[tuple[frozenset[int], float]]:
    """The pairs of bodies in contact, and how deep they are in each other, m."""
    for contact in data.contact:
        yield frozenset(data.model.geom_bodyid[contact.geom].tolist()), -contact.dist


def _authority(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    """Each servo alone moves its own joint and what follows it or shares its tendon, and no other."""
    robot, (C, _), unit = cell.robot, cell.robot.drive, robot_tree(cell).unit
    moving, faults = robot.free[0] @ C, []
    free = copy.copy(home.model)
    free.opt.disableflags |= (
        mujoco.mjtDisableBit.mjDSBL_CONTACT
    )  # fingers beside each other are no matter of servos
    alone = _at(free, home.qpos)
    for j in np.flatnonzero(C.any(0)):  # the others follow
        name, push = robot.joints[j], 0.1 * unit[j]  # rad
        ways = [_moved(alone, C[:, j], way) for way in (push, -push)]
        moved = max(ways, key=lambda way: way[j])  # an end of the range may be in the way
        strays = np.delete(np.abs(moved - moving[:, j]), j)
        if moved[j] < 0.8 * moving[j, j]:
            lags = f"joint {name} follows its servo by {100 * moved[j] / moving[j, j]:.0f} %"
            mend = "raise its stiffness or torque, or look for a second servo that holds it"
            faults.append(Finding("error", lags, mend))
        elif strays.max() > 0.3:
            other = np.delete(robot.joints, j)[strays.argmax()]
            mend = "one servo a joint, of the joint's name"
            faults.append(Finding("error", f"servo {name} moves joint {other}", mend))
    yield from faults or [Finding("info", "every servo moves its joint, and no other")]


def _moved(home: mujoco.MjData, column: Array, push: float) -> Array:
    """Return how far joints (n,) go when set-points move by `push` along a column (n,), in shares of it."""
    data = _at(home.model, home.qpos)
    data.ctrl[:] += push * column
    mujoco.mj_step(home.model, data, 400)
    return (data.qpos - home.qpos) / push


def _tips(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    """The surface of each grasping tip is a radius from its site, out of the tip and out of its pad.

    A jaw closes between the two, and its pad may be flat.
    """
    radius = cell.robot.hand.tip_radius
    mend = f"shift the tip's frame, or change tip_radius, {1000 * radius:.1f} mm"
    for finger in cell.robot.grasping:
        site = home.site(finger.tip)
        end, pad = site.xmat.reshape(3, 3)[:, 2], _pad(home, finger)
        jaw = cell.robot.hand.torsion > 0.0
        for what, way in {"pad": (end + pad) / np.sqrt(2.0)}.items() if jaw else (("end", end), ("pad", pad)):
            depth = _surface(home, home.model.geom(finger.tip).id, site.xpos, way)
            far = f"the {what} of {finger.tip} is {1000 * depth:.1f} mm from its centre"
            yield _finding(abs(depth - radius) <= _OFF, far, mend)


def _surface(data: mujoco.MjData, geom: int, centre: Array, way: Array) -> float:
    """Return how far a geom reaches from a point along a direction, m: what a ray from outside meets."""
    model, normal, far = data.model, np.zeros(3), 0.1
    start = centre + far * way
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        hit = mujoco.mj_rayMesh(model, data, geom, start, -way, normal)
    else:
        placed = data.geom_xpos[geom], data.geom_xmat[geom], model.geom_size[geom]
        hit = mujoco.mju_rayGeom(*placed, start, -way, int(model.geom_type[geom]), normal)
    return far - hit if hit >= 0 else far


def _opposition(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    """The open hand's tips are in front of the palm, and the first one's pad faces the others."""
    palm = home.site(cell.robot.hand.palm)
    front = (fingertips(cell.robot.home, robot_tree(cell)) - palm.xpos) @ palm.xmat.reshape(3, 3)[:, 0]
    if front.min() < 0.02:
        mend = "the palm frame's x has to point out of the palm's face; or bend `open` further"
        yield Finding("error", f"an open tip is {1000 * front.min():.0f} mm in front of the palm", mend)
    tips = np.array([home.site(finger.tip).xpos for finger in cell.robot.grasping])
    between = tips[1:].mean(0) - tips[0]
    facing = _pad(home, cell.robot.grasping[0]) @ between / np.linalg.norm(between)
    if facing < 0.0:
        mend = "x of a tip's frame has to point out of its pad; or change `open`, or which finger is first in `grasp`"
        yield Finding("error", f"the pad of {cell.robot.hand.grasp[0]} looks away from the others", mend)
    else:
        yield Finding("info", f"open, the tips of a grasp are {1000 * np.linalg.norm(between):.0f} mm apart")


def _meeting(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    """Each finger of a grasp gets its pad before the first one's, in some posture."""
    first, *others = cell.robot.hand.grasp
    for finger, gap in zip(others, closed_posture(cell)[1], strict=True):
        if gap < 0.06:  # m between pads that a grasp can be made with
            yield Finding("info", f"the pads of {first} and {finger} can face each other")
        else:
            mend = "other fingers in `grasp`, wider ranges, or x of the tips' frames out of the pads"
            yield Finding("error", f"no posture has the pads of {first} and {finger} face each other", mend)


def closed_posture(cell: Cell) -> tuple[Array, Array]:
    """Return the posture in which the pads of a grasp come nearest to each other, and how near they can come.

    Returns:
        (n,) rad, the arm at home; (g - 1,) m from the first tip to the others', inf where pads never face each other.
    """
    robot, hand, rng = cell.robot, cell.robot.hand_columns, np.random.default_rng(0)
    drawn = np.tile(robot.home, (800, 1))
    drawn[:, hand] = rng.uniform(robot.lower[hand], robot.upper[hand], drawn[:, hand].shape)
    for finger in robot.hand.fingers:
        if finger not in robot.grasping and finger.aside:
            drawn[:, robot.columns[finger.name]] = finger.aside
    drawn = drawn @ robot.drive[0].T + robot.drive[1]
    tips, pads = np.empty((2, len(robot.grasping), len(drawn), 3))
    for k, data in enumerate(swept(compiled_robot(cell), drawn)):
        for f, finger in enumerate(robot.grasping):
            tips[f, k] = data.site(finger.tip).xpos
            pads[f, k] = _pad(data, finger)
    gaps = np.stack([_gaps(tips[0], pads[0], *of) for of in zip(tips[1:], pads[1:], strict=True)])
    thumb = gaps.min(2).max(0).argmin()
    closed = drawn[thumb]
    for finger, own in zip(robot.grasping[1:], gaps[:, thumb], strict=True):
        columns = robot.columns[finger.name]
        closed[columns] = drawn[own.argmin(), columns]
    return closed, gaps.min((1, 2)) - 2.0 * robot.hand.tip_radius


def _gaps(first: Array, own: Array, other: Array, theirs: Array) -> Array:
    """Distances (n, m) m of tips in n and m postures, inf where their pads do not face each other."""
    between = other - first[:, None]
    distance = np.maximum(np.linalg.norm(between, axis=2), 1e-9)
    facing = (between * own[:, None]).sum(2), -(between * theirs).sum(2)
    return np.where(np.minimum(*facing) > 0.5 * distance, distance, np.inf)


def _bearing(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    """Report the share of its torque that the arm needs to bear itself and the hand, at home and over the table."""
    arm = cell.robot.arm_columns
    postures = [cell.robot.home, *_palms_down(cell).values()]
    share = (
        np.max([np.abs(_at(home.model, q).qfrc_bias[arm]) for q in postures], axis=0) / cell.robot.torque[arm]
    )
    name = f"{cell.robot.joints[int(share.argmax())]} needs {100 * share.max():.0f} % of its torque to bear its weight"
    yield _finding(share.max() <= 0.9, name, "state the maker's torque, or the true masses in the MJCF")


def _reach(cell: Cell, home: mujoco.MjData) -> Iterator[Finding]:
    """Palms that look down on the middle of the table, or aslant and away from the base where few do."""
    found, half = {*_palms_down(cell)}, len(_PALMS) // 2
    for slant in (0.4, 0.8):  # rad
        found |= {*_palms_down(cell, slant)} if len(found) < half else set()
    places = {(x, y) for x, y, _ in found}
    mend = (
        f"a longer arm (this one reaches {cell.robot.arm.reach:.2f} m), its `home` or `starts`, or the mount"
    )
    what = f"{len(found)} of {len(_PALMS)} palm poses over the table are reached"
    yield _finding(len(found) >= half, what, mend, "warning" if len(places) > 4 else "error")


@lru_cache(maxsize=3)
def _palms_down(cell: Cell, slant: float = 0.0) -> dict[tuple[float, ...], Array]:
    """Postures (n,) rad of palms that look down on the middle of the table; by a slant, rad, away from the base."""
    tree, found = robot_tree(cell), dict[tuple[float, ...], Array]()
    c, s = np.cos(slant), np.sin(slant)
    for x, y, yaw in _PALMS:
        q, out = tree.home.copy(), about_z(np.arctan2(y, x))
        R = out @ [[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]] @ out.T @ about_z(yaw) @ PALM_DOWN
        reached = reach_palm(q, R, np.array([x, y, 0.2]) - 0.12 * s * out[:, 0], tree)
        if reached and body_frames(q, tree).p[tree.base : tree.palm, 2].min() > 0.0:
            found[x, y, yaw] = q
    return found
