"""Couplings that a maker's description states: equalities of joints, slackless tendons, and loops of bodies.

A loop is reduced to its drive: the description's own model moves the drive through its range, and each joint that
moves with it is fitted with a line.
"""

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.description import bearers
from dexgrasp_env.robot.robot import SLIDE, Coupling
from dexgrasp_env.robot.source import wrapped_joints

Lines = dict[int, tuple[int, float, float]]
"""Follower: leader, ratio, offset."""

_OFF = 0.15  # rad or a tenth of m that joints may be off a line
DRIVES_JOINT = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)


class Coupled(NamedTuple):
    """Joints of a description that do not move alone."""

    couplings: list[Coupling]
    still: list[str]
    """Joints that loops hold where they are."""
    notes: list[str]


def couplings(model: mujoco.MjModel, path: Path) -> Coupled:
    """Return the joints that follow others, each referred to the joint that leads in the end.

    Raises:
        InputError: for loops without a drive or with several, and for couplings far from straight lines.
    """
    lines, still, notes = stated_lines(model), list[str](), list[str]()
    if has_loops(model):
        still, notes = _reduce_loops(model, path, lines)
    for e in _active(model, mujoco.mjtEq.mjEQ_JOINT):
        place, ratio, off = _line(model, e)
        name = model.joint(int(model.eq_obj1id[e])).name
        if off > _OFF:
            raise InputError(f"{path} couples joint {name!r} by a curve: it is {off:.2g} off a line")
        if off > 0.0:
            notes.append(
                f"hand couplings: {name} is on a curve, and on a line within {off:.2g} rad of it here"
            )
        elif ratio == 0.0 and abs(place) > 0.02:  # rad
            raise InputError(
                f"{path} holds joint {name!r} at {place:g} by an equality: make it a fixed one there"
            )
        elif ratio == 0.0:
            still.append(name)
            notes.append(f"hand held: {name} stands still at 0, as an equality says")
    if any(np.abs(model.eq_data[e, 2:5]).max() > 1e-6 for e in _active(model, mujoco.mjtEq.mjEQ_TENDON)):
        raise InputError(f"{path} ties tendons by a curve: valid is a straight line, polycoef of two numbers")
    found = []
    for follower, (leader, ratio, offset) in lines.items():
        for _ in lines:
            if leader not in lines:
                break
            leader, more, shift = lines[leader]
            ratio, offset = ratio * more, offset + ratio * shift
        if leader in lines:
            raise InputError(f"{path} couples joint {model.joint(follower).name!r} to itself")
        names = model.joint(follower).name, model.joint(leader).name
        if _beyond(model, follower, offset + ratio * model.jnt_range[leader]):
            still.append(names[0])
            notes.append(f"hand held: {names[0]} stands still at 0: what couples it leads out of its range")
        else:
            found.append(Coupling(*names, round(ratio, 9), round(offset, 9)))
    return Coupled(found, still, notes)


def _beyond(model: mujoco.MjModel, joint: int, places: Array) -> bool:
    """Return True if places (2,), from one to the other, are all beyond the end of a joint's range that is 0."""
    (low, high), ends = np.round(model.jnt_range[joint], 3), np.round(places, 3)
    if not model.jnt_limited[joint] or not np.ptp(places) or not ends.any():
        return False
    return bool((low == 0.0 and ends.max() <= 0.0) or (high == 0.0 and ends.min() >= 0.0))


def stated_lines(model: mujoco.MjModel) -> Lines:
    """Return the couplings that active equalities and slackless tendons state as straight lines.

    A servo's tendon between two fingers moves both by its coefficients.
    """
    lines, driven = Lines(), set(_driven(model))
    for e in _active(model, mujoco.mjtEq.mjEQ_JOINT):
        follower, leader = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        offset, ratio, off = _line(model, e)
        if ratio == 0.0 or off > _OFF:
            continue
        if follower in driven and leader not in driven:
            follower, leader, ratio, offset = leader, follower, 1.0 / ratio, -offset / ratio
        lines[follower] = leader, ratio, offset
    for terms, length in _constant_sums(model):
        if len(terms) == 2:
            (leader, a), (follower, b) = sorted(terms.items())
            lines[follower] = leader, -a / b, length / b
    for tendon in model.actuator_trnid[model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON, 0].tolist():
        joints, coefs = wrapped_joints(model, tendon)
        if len(joints) == 2 and not set(joints) & (lines.keys() | {of for of, *_ in lines.values()}):
            first, second = (bearers(model, body) for body in model.jnt_bodyid[joints])
            if first[0] not in second and second[0] not in first:
                lines[joints[1]] = joints[0], coefs[1] / coefs[0], 0.0
    return lines


def _constant_sums(model: mujoco.MjModel) -> Iterator[tuple[dict[int, float], float]]:
    """Yield coefficients of joints whose sum stays as it is, and what it is: of slackless tendons, springs, and ties.

    A spring between a joint that is driven and one that is not counts as rigid.
    """
    driven = set(_driven(model))
    for tendon in range(model.ntendon):
        joints, coefs = wrapped_joints(model, tendon)
        sprung = model.tendon_stiffness[tendon] > 0.0 and len({*joints} & driven) == 1
        ends = (model.tendon_lengthspring if sprung else model.tendon_range)[tendon]
        slack = np.ptp(ends)  # m, or in units of the coefficients
        tight = len(joints) == 2 and coefs[0] * coefs[1] < 0 and slack < 0.3 * min(map(abs, coefs))
        if tight and (sprung or model.tendon_limited[tendon]):
            yield dict(zip(joints, coefs, strict=True)), float(ends.mean())
    for e in _active(model, mujoco.mjtEq.mjEQ_TENDON):
        found, (offset, ratio) = dict[int, float](), model.eq_data[e, :2].tolist()
        for tendon, share in ((model.eq_obj1id[e], 1.0), (model.eq_obj2id[e], -ratio)):
            for joint, coef in zip(*wrapped_joints(model, tendon), strict=True) if tendon >= 0 else ():
                found[joint] = found.get(joint, 0.0) + share * coef
        moved = {joint: coef for joint, coef in found.items() if coef}
        yield moved, offset + sum(coef * float(model.qpos0[joint]) for joint, coef in moved.items())


def has_loops(model: mujoco.MjModel) -> bool:
    """Tell whether active equalities join bodies that move against each other."""
    for e in _active(model, mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
        ends = [model.eq_obj1id[e], model.eq_obj2id[e]]
        bodies = model.site_bodyid[ends] if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE else ends
        if np.ptp(model.body_weldid[bodies]):
            return True
    return False


def led_by(found: list[Coupling], leader: str) -> list[Coupling]:
    """Return couplings in which a joint that follows leads its group instead."""
    own = next((c for c in found if c.joint == leader), None)
    if own is None or abs(own.ratio) < 1e-9:
        return found
    turned = [Coupling(own.follows, leader, 1.0 / own.ratio, -own.offset / own.ratio)]
    for c in found:
        if c.follows == own.follows and c is not own:
            ratio = c.ratio / own.ratio
            turned.append(Coupling(c.joint, leader, ratio, c.offset - ratio * own.offset))
    return [c for c in found if c.follows != own.follows] + turned


def narrow(joints: list[str], limits: Fields, found: list[Coupling]) -> None:
    """Narrow the range of each leading joint to where those that follow it stay in theirs."""
    for own in found:
        if own.joint not in joints or own.follows not in joints:
            continue
        k, leader = joints.index(own.joint), joints.index(own.follows)
        ends = sorted((limits[side][k] - own.offset) / own.ratio for side in ("lower", "upper"))
        low, high = max(ends[0], limits["lower"][leader]), min(ends[1], limits["upper"][leader])
        if low < high:
            limits["lower"][leader], limits["upper"][leader] = low, high
        ends = sorted(own.offset + own.ratio * limits[side][leader] for side in ("lower", "upper"))
        limits["lower"][k] = min(limits["lower"][k], ends[0])
        limits["upper"][k] = max(limits["upper"][k], ends[1])


def share(joints: list[str], torque: list[float], found: list[Coupling]) -> None:
    """Share the torque of each drive among the joints that it moves, as each has a servo here."""
    for leader in {own.follows for own in found} & {*joints}:
        ratios = {joints.index(leader): 1.0} | {
            joints.index(own.joint): abs(own.ratio) for own in found if own.follows == leader
        }
        each = sum(ratio * torque[k] for k, ratio in ratios.items()) / sum(ratios.values())
        for k in ratios:
            torque[k] = float(f"{each:.6g}")


def _active(model: mujoco.MjModel, *kinds: mujoco.mjtEq) -> list[int]:
    """Return the active equalities of some kinds."""
    return np.flatnonzero(np.isin(model.eq_type, kinds) & model.eq_active0.astype(bool)).tolist()


def _line(model: mujoco.MjModel, e: int) -> tuple[float, float, float]:
    """Return offset and ratio of what an equality says of a joint by its leader, and how far off it is.

    A curve gets the line that is nearest to it where both joints are in their ranges, from which it is some rad off, or
    tenths of a metre.
    """
    follower, leader = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
    offset, ratio, *curved = model.eq_data[e, :5].tolist()
    if leader < 0:
        return offset + float(model.qpos0[follower]), 0.0, 0.0
    at = float(model.qpos0[leader])
    if max(map(abs, curved)) <= 1e-6:
        ratio = ratio if abs(ratio) > 1e-9 else 0.0
        return offset + float(model.qpos0[follower] - ratio * at), ratio, 0.0
    ends = model.jnt_range[leader].tolist() if model.jnt_limited[leader] else [at - np.pi, at + np.pi]
    u = np.linspace(ends[0], ends[1], 100)
    q = np.polynomial.Polynomial(model.eq_data[e, :5])(u - at) + model.qpos0[follower]
    low, high = model.jnt_range[follower] if model.jnt_limited[follower] else (-np.inf, np.inf)
    inside = (q >= low - 1e-6) & (q <= high + 1e-6)
    if inside.sum() < 2:
        return 0.0, 0.0, np.inf
    ratio, offset = np.polyfit(u[inside], q[inside], 1).tolist()
    unit = SLIDE if model.jnt_type[follower] == mujoco.mjtJoint.mjJNT_SLIDE else 1.0
    return offset, ratio, float(np.abs(ratio * u + offset - q)[inside].max()) / unit


def _driven(model: mujoco.MjModel) -> list[int]:
    """Return the joints that actuators drive, alone or by fixed tendons."""
    found = model.actuator_trnid[np.isin(model.actuator_trntype, DRIVES_JOINT), 0].tolist()
    pulled = model.actuator_trnid[model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON, 0].tolist()
    return [*found, *(j for tendon in pulled for j in wrapped_joints(model, tendon)[0])]


def _reduce_loops(model: mujoco.MjModel, path: Path, lines: Lines) -> tuple[list[str], list[str]]:
    """Add to `lines` the joints that loops move with their drives; return those that they hold, and what to note."""
    drives = [j for j in dict.fromkeys(_driven(model)) if j not in lines]
    if not drives:
        raise InputError(f"{path} closes loops of bodies that no actuator drives: add one to its <actuator>")
    if (model.jnt_type == mujoco.mjtJoint.mjJNT_BALL).any():
        raise InputError(f"{path} closes loops by ball joints: valid are loops of hinges and slides")
    worst, unit = 0.0, np.where(model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE, SLIDE, 1.0)
    free = [j for j in range(model.njnt) if j not in drives and j not in lines]
    for drive in drives:
        u, q = _swept(model, drive, drives)
        for j in free:
            if np.ptp(q[:, j]) < 0.02 * unit[j]:  # it stands still
                continue
            name = model.joint(j).name
            if j in lines:
                raise InputError(f"{path}: loops move joint {name!r} with several drives: valid is one")
            ratio, offset = np.polyfit(u, q[:, j], 1)
            off = np.abs(ratio * u + offset - q[:, j]).max()
            if off > _OFF * unit[j]:
                ends = "" if model.jnt_limited[drive] else f"; {model.joint(drive).name!r} lacks a range"
                raise InputError(
                    f"{path} couples joint {name!r} by a curve: it is {off:.2g} off a line{ends}"
                )
            lines[j], worst = (drive, float(ratio), float(offset)), max(worst, off)
    still = [model.joint(j).name for j in free if j not in lines]
    return still, [
        f"hand couplings: loops are reduced to their drives; joints are on lines of them within {worst:.2g}"
    ]


def _swept(model: mujoco.MjModel, drive: int, drives: list[int]) -> tuple[Array, Array]:
    """Return places (k,) of a drive at which the loops close, and the joints (k, n) there; other drives stand.

    From one place to the next the physics runs for 60 steps, loops all but rigid, and nothing pushes the drives back.
    """
    m = copy.copy(model)
    m.opt.gravity[:] = 0.0
    m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    m.dof_damping[:], m.dof_frictionloss[:] = 20.0 * m.dof_M0, 0.0
    m.eq_solref[:], m.eq_solimp[:, :2] = (0.006, 1.0), (0.99, 0.999)
    m.dof_armature[m.jnt_dofadr[drives]] = 1e6
    at, low_high = m.jnt_qposadr[drive], m.jnt_range[drive]
    if not m.jnt_limited[drive]:
        low_high = m.qpos0[at] + np.array([-np.pi, np.pi])
    found = list[tuple[float, Array]]()
    for end in low_high:
        data = mujoco.MjData(m)
        for u in np.linspace(m.qpos0[at], end, 24):
            for _ in range(60):
                data.qpos[at], data.qvel[m.jnt_dofadr[drive]] = u, 0.0
                mujoco.mj_step(m, data)
            mujoco.mj_forward(m, data)
            if (
                np.abs(data.efc_pos[: data.ne]).max(initial=0.0) > 0.003
            ):  # m or rad that a loop misses: the drive is at its end
                break
            found.append((float(u), data.qpos[m.jnt_qposadr].copy()))
    found.sort(key=lambda row: row[0])
    return np.array([u for u, _ in found]), np.array([q for _, q in found])
