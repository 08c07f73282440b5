"""Couplings that a maker's description states: equalities of joints, and tendons without slack between two joints."""

from pathlib import Path

import mujoco
import numpy as np

from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.coupled import Coupling


def couplings(model: mujoco.MjModel, path: Path) -> list[Coupling]:
    """Return the joints that follow others by active equalities, each referred to the joint that leads in the end.

    Raises:
        InputError: for loops of bodies, and for couplings that are no straight lines.
    """
    lines = dict[int, tuple[int, float, float]]()  # follower: leader, ratio, offset
    driven = set(model.actuator_trnid[np.isin(model.actuator_trntype, DRIVES_JOINT), 0].tolist())
    for e in np.flatnonzero(model.eq_active0).tolist():
        if model.eq_type[e] != mujoco.mjtEq.mjEQ_JOINT:
            kind = mujoco.mjtEq(model.eq_type[e]).name.removeprefix("mjEQ_").lower()
            raise InputError(
                f"{path} closes a loop by equality {kind} {model.equality(e).name!r}: valid are trees"
            )
        follower, leader = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        offset, ratio, *curve = map(float, model.eq_data[e, :5])
        if leader < 0:
            continue
        if np.abs(curve).max() > 1e-6 or abs(ratio) < 1e-9:
            raise InputError(
                f"{path} couples joint {model.joint(follower).name!r} by a curve: valid is a line"
            )
        offset += float(model.qpos0[follower] - ratio * model.qpos0[leader])
        if follower in driven and leader not in driven:
            follower, leader, ratio, offset = leader, follower, 1.0 / ratio, -offset / ratio
        lines[follower] = leader, ratio, offset
    for tendon in np.flatnonzero(model.tendon_limited).tolist():
        joints, coefs = wrapped_joints(model, tendon)
        slack = np.ptp(model.tendon_range[tendon])
        if len(joints) == 2 and coefs[0] * coefs[1] < 0 and slack < _SLACK * min(map(abs, coefs)):
            (leader, a), (follower, b) = sorted(zip(joints, coefs, strict=True))
            lines[follower] = leader, -a / b, float(model.tendon_range[tendon].mean() / b)
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
        found.append(Coupling(*names, round(ratio, 9), round(offset, 9)))
    return found


def wrapped_joints(model: mujoco.MjModel, tendon: int) -> tuple[list[int], list[float]]:
    """Return the joints of a fixed tendon and their coefficients; nothing of one that runs over sites or pulleys."""
    own = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
    if (model.wrap_type[own] != mujoco.mjtWrap.mjWRAP_JOINT).any():
        return [], []
    return model.wrap_objid[own].tolist(), model.wrap_prm[own].tolist()


_SLACK = 0.3  # rad that a tendon between two joints may leave: they are coupled
DRIVES_JOINT = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
