"""Actions to set-points, compiled: the control modes, latency and disturbances, over rows of environments.

This module imports numba: it is imported when an environment is made.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.compiled import njit
from dexgrasp_env.poses import product_components, rotated_components
from dexgrasp_env.scene.constants import CONTROL_PERIOD
from dexgrasp_env.tasks.constants import PALM_STEP, PALM_TURN, at_pace
from dexgrasp_env.tasks.control import CONTROL_MODES, max_step
from dexgrasp_env.tasks.disturbance import KINDS, PAUSE_STEPS, PUSH_STEPS
from dexgrasp_env.tasks.records import COMMANDS, PHASES, Record, Records
from dexgrasp_env.tasks.settings import LiftSettings

_product = njit(product_components)
_rotated = njit(rotated_components)

_POSITION, _DELTA = CONTROL_MODES.index("joint_position"), CONTROL_MODES.index("joint_delta")
_PUSHED, _SHAKEN = KINDS.index("pushed"), KINDS.index("shaken")
_RUNNING = PHASES.index("running")

_LOWER, _UPPER, _STEP, _HOME = range(4)
_TARGETS, _COMMAND, _BEFORE = range(len(COMMANDS))

_GRAVITY = 9.81  # m/s^2, MuJoCo's default
_DAMPING = 0.02  # of the least-squares inverse; keeps joint steps bounded near singularities
_POSTURE_GAIN = 0.05  # pull towards home in the arm's null space, per 50 ms


class Control(NamedTuple):
    """What actions and disturbances do to a robot of n joints, a of them the arm's.

    Attributes:
        mode: index of `CONTROL_MODES`.
        chain: (a + 1, 7) fixed poses of the arm's joints and of the palm, each in the frame before.
        joints: (4, n) rad, ranges, largest step and home.
        shaken: (2,) the joints that a shaking turns.
        kind: index of `disturbance.KINDS`.
        size: of the disturbance.
        push: control steps of a push, and of the pause after it.
        period: s, of a control step.
        scale: of the actions that are changes.
    """

    mode: int
    chain: Array
    joints: Array
    shaken: NDArray[np.int64]
    kind: int
    size: float
    push: tuple[int, int]
    period: float
    scale: float


def control_of(settings: LiftSettings, chain: Array) -> Control:
    """Return the control of an environment; see `Control`."""
    robot, disturbance, period = settings.cell.robot, settings.disturbance, settings.period
    joints = np.stack([robot.lower, robot.upper, max_step(robot, period), robot.home])
    shaken = np.array(robot.arm.shaken, dtype=np.int64)
    push = at_pace(PUSH_STEPS, settings.frame_skip), at_pace(PAUSE_STEPS, settings.frame_skip)
    return Control(
        CONTROL_MODES.index(settings.control_mode), chain, joints, shaken, KINDS.index(disturbance.kind),
        disturbance.size, push, period, settings.action_scale,
    )  # fmt: skip


@njit
def set_points(
    episodes: Records, commands: Array, actions: Array, control: Control, rows: Array, push: Array
) -> bool:
    """Move the set-points by one control step.

    Args:
        episodes: (N,); the count of steps is advanced.
        commands: (N, 3, n) rad, `COMMANDS`; advanced.
        actions: (N, m); clipped to [-1, 1] in place.
        control: of the robot.
        rows: (N, frame_skip, n) out, what the servos are told in each physics step, rad.
        push: (N, 3) out, force on the object's centre of mass during the control step, N.

    Returns:
        False, with nothing done, where an action is not finite.
    """
    for action in actions.flat:
        if not math.isfinite(action):
            return False
    for i in range(len(episodes)):
        e, c = episodes[i], commands[i]
        e.elapsed += 1
        for j in range(actions.shape[1]):
            actions[i, j] = min(max(actions[i, j], -1.0), 1.0)
        _advance_targets(c[_TARGETS], actions[i], control)
        command = _command(e, c[_TARGETS], control)
        _ramp(c[_BEFORE], c[_COMMAND], command, e.latency, rows[i])
        c[_BEFORE] = c[_COMMAND]
        c[_COMMAND] = command
        _push(e, control, push[i])
    return True


@njit
def _advance_targets(targets: Array, action: Array, control: Control) -> None:
    mode, joints, scale = control.mode, control.joints, control.scale
    lower, upper, most = joints[_LOWER], joints[_UPPER], joints[_STEP]
    n, arm_dof = joints.shape[1], control.chain.shape[0] - 1
    if mode == _POSITION:
        for j in range(n):
            _move(targets, j, lower[j] + 0.5 * (action[j] + 1.0) * (upper[j] - lower[j]), joints)
    elif mode == _DELTA:
        for j in range(n):
            _move(targets, j, targets[j] + scale * action[j] * most[j], joints)
    else:
        arm = _palm_step(action, targets, control)
        for j in range(arm_dof):
            _move(targets, j, arm[j], joints)
        for j in range(arm_dof, n):
            desired = lower[j] + 0.5 * (action[6 + j - arm_dof] + 1.0) * (upper[j] - lower[j])
            _move(targets, j, desired, joints)


@njit
def _move(targets: Array, j: int, desired: float, joints: Array) -> None:
    """Take one set-point towards a desired one, within the joint's velocity limit and range."""
    most = joints[_STEP, j]
    step = min(max(desired - targets[j], -most), most)
    targets[j] = min(max(targets[j] + step, joints[_LOWER, j]), joints[_UPPER, j])


@njit
def _palm_step(action: Array, targets: Array, control: Control) -> Array:
    """Return arm positions (a,) that move the palm by the action: damped least squares, home in the null space."""
    joints, share = control.joints, control.period / CONTROL_PERIOD
    J = palm_jacobian(targets, control.chain)
    n, scale = J.shape[1], share * control.scale
    pull = np.empty(n)
    for j in range(n):
        pull[j] = share * _POSTURE_GAIN * (joints[_HOME, j] - targets[j])
    residual = np.empty(6)
    for r in range(6):
        residual[r] = scale * action[r] * (PALM_STEP if r < 3 else PALM_TURN)
        for j in range(n):
            residual[r] -= J[r, j] * pull[j]
    weights = _solve(J, residual)
    step = np.empty(n)
    excess = 1.0
    for j in range(n):
        step[j] = pull[j]
        for r in range(6):
            step[j] += J[r, j] * weights[r]
        excess = max(excess, abs(step[j]) / joints[_STEP, j])
    # One factor for all joints keeps the direction of the palm's motion.
    for j in range(n):
        step[j] = targets[j] + step[j] / excess
    return step


@njit
def palm_jacobian(targets: Array, chain: Array) -> Array:
    """Jacobian of the palm (6, a) at arm positions: rows linear m and angular rad in the world frame."""
    n = chain.shape[0] - 1
    axes, anchors = np.empty((n, 3)), np.empty((n + 1, 3))
    q = (1.0, 0.0, 0.0, 0.0)
    x, y, z = 0.0, 0.0, 0.0
    for j in range(n + 1):
        c = chain[j]
        dx, dy, dz = _rotated(q, (c[0], c[1], c[2]))
        x, y, z = x + dx, y + dy, z + dz
        anchors[j, 0], anchors[j, 1], anchors[j, 2] = x, y, z
        q = _product(q, (c[3], c[4], c[5], c[6]))
        if j < n:
            axes[j, 0], axes[j, 1], axes[j, 2] = _rotated(q, (0.0, 0.0, 1.0))
            half = 0.5 * targets[j]
            q = _product(q, (math.cos(half), 0.0, 0.0, math.sin(half)))
    J = np.empty((6, n))
    for j in range(n):
        a, b, c = axes[j]
        dx, dy, dz = x - anchors[j, 0], y - anchors[j, 1], z - anchors[j, 2]
        J[0, j], J[1, j], J[2, j] = b * dz - c * dy, c * dx - a * dz, a * dy - b * dx
        J[3, j], J[4, j], J[5, j] = a, b, c
    return J


@njit
def _solve(J: Array, b: Array) -> Array:
    """Return x (6,) with (J Jt + d^2 I) x = b by Cholesky, which keeps to one order of operations."""
    L = np.zeros((6, 6))
    for r in range(6):
        for c in range(r + 1):
            total = _DAMPING * _DAMPING if r == c else 0.0
            for j in range(J.shape[1]):
                total += J[r, j] * J[c, j]
            for k in range(c):
                total -= L[r, k] * L[c, k]
            L[r, c] = math.sqrt(total) if r == c else total / L[c, c]
    x = b.copy()
    for r in range(6):
        for k in range(r):
            x[r] -= L[r, k] * x[k]
        x[r] /= L[r, r]
    for r in range(5, -1, -1):
        for k in range(r + 1, 6):
            x[r] -= L[k, r] * x[k]
        x[r] /= L[r, r]
    return x


@njit
def _command(e: Record, targets: Array, control: Control) -> Array:
    """Return what the servos are to be told at the end of the control step, (n,): targets and shaking."""
    command, joints, size = targets.copy(), control.joints, control.size
    if control.kind == _SHAKEN and e.phase == _RUNNING:
        t = (e.disturbed + 1) * control.period
        first, second = control.shaken
        command[first] += size * 0.06 * math.sin(2.0 * math.pi * 3.0 * t)
        command[second] += size * 0.04 * (math.sin(2.0 * math.pi * 2.4 * t + 1.0) - math.sin(1.0))
        for j in (first, second):
            command[j] = min(max(command[j], joints[_LOWER, j]), joints[_UPPER, j])
    return command


@njit
def _ramp(before: Array, start: Array, end: Array, latency: int, rows: Array) -> None:
    """Fill rows (frame_skip, n) of commands: evenly from `start` to exactly `end`, late by `latency`."""
    steps = len(rows)
    for k in range(steps):
        at = k + 1 - latency
        if at == steps:
            rows[k] = end
        elif at > 0:
            fraction = at / steps
            for j in range(len(start)):
                rows[k, j] = start[j] + fraction * (end[j] - start[j])
        elif at == 0:
            rows[k] = start
        else:
            fraction = (steps + at) / steps
            for j in range(len(start)):
                rows[k, j] = before[j] + fraction * (start[j] - before[j])


@njit
def _push(e: Record, control: Control, push: Array) -> None:
    push[:] = 0.0
    lasts, pause = control.push
    turn, at = divmod(e.disturbed, lasts + pause)
    if control.kind == _PUSHED and e.phase == _RUNNING and at < lasts:
        push[turn // 2] = control.size * e.mass * _GRAVITY * (1.0 if turn % 2 == 0 else -1.0)
