"""Actions to set-points, compiled: the control modes, latency and disturbances, over rows of environments.

This module imports numba: it is imported when an environment is made.
"""

import math
from typing import NamedTuple

import numpy as np

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.compiled import njit
from dexgrasp_env.scene.constants import CONTROL_PERIOD, GRAVITY
from dexgrasp_env.tasks.constants import PALM_STEP, PALM_TURN, at_pace
from dexgrasp_env.tasks.control import DIRECT_MODES, GRASP_MODES, max_step
from dexgrasp_env.tasks.disturbance import KINDS, PAUSE_STEPS, PUSH_STEPS
from dexgrasp_env.tasks.kernel import product, rotated
from dexgrasp_env.tasks.records import COMMANDS, PHASES, Record, Records
from dexgrasp_env.tasks.settings import LiftSettings

_DELTA, _PALM = DIRECT_MODES.index("joint_delta"), DIRECT_MODES.index("ee_delta")
_PUSHED, _SHAKEN = KINDS.index("pushed"), KINDS.index("shaken")
_RUNNING = PHASES.index("running")

_LOWER, _UPPER, _STEP, _HOME = range(4)
_TARGETS, _COMMAND, _BEFORE = range(len(COMMANDS))

_DAMPING = 0.02  # of the least-squares inverse; keeps joint steps bounded near singularities
_POSTURE_GAIN = 0.05  # pull towards home in the arm's null space, per 50 ms


class Control(NamedTuple):
    """Constants of actions and disturbances, for a robot of n joints, a of them the arm's.

    Attributes:
        mode: index of `DIRECT_MODES`.
        chain: (a + 1, 7) fixed poses of the arm's joints and of the palm, each in the frame before.
        joints: (4, n) rad, ranges, largest step and home.
        shaken: (2,) the joints that a shaking turns.
        kind: index of `disturbance.KINDS`.
        size: of the disturbance.
        push: (2,) control steps of a push, and of the pause after it.
        period: s, of a control step.
        scale: of the actions that are changes.
    """

    mode: int
    chain: Array
    joints: Array
    shaken: Index
    kind: int
    size: float
    push: Index
    period: float
    scale: float


def control_of(settings: LiftSettings, chain: Array) -> Control:
    """Return the control of an environment; see `Control`."""
    mode = "ee_delta" if settings.control_mode in GRASP_MODES else settings.control_mode
    robot, disturbance, period = settings.cell.robot, settings.disturbance, settings.period
    joints = np.stack([robot.lower, robot.upper, max_step(robot, period), robot.home])
    push = np.array([at_pace(steps, settings.frame_skip) for steps in (PUSH_STEPS, PAUSE_STEPS)])
    return Control(
        DIRECT_MODES.index(mode), chain, joints, np.array(robot.arm.shaken, np.int64),
        KINDS.index(disturbance.kind), disturbance.size, push, period, settings.action_scale,
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
        advance(episodes[i], commands[i], actions[i], control, rows[i], push[i])
    return True


@njit
def advance(e: Record, c: Array, action: Array, control: Control, rows: Array, push: Array) -> None:
    """Move the set-points of one episode, by a finite action; arguments as of `set_points`, without the first axis."""
    e.elapsed += 1
    for j in range(len(action)):
        action[j] = min(max(action[j], -1.0), 1.0)
    _advance_targets(c[_TARGETS], action, control)
    for j in range(control.joints.shape[1]):
        end = _command(e, c[_TARGETS, j], j, control)
        for k in range(rows.shape[0]):
            rows[k, j] = _ramp(c[_BEFORE, j], c[_COMMAND, j], end, k + 1 - e.latency, rows.shape[0])
        c[_BEFORE, j] = c[_COMMAND, j]
        c[_COMMAND, j] = end
    _push(e, control, push)


@njit
def _advance_targets(targets: Array, action: Array, control: Control) -> None:
    mode, joints, scale = control.mode, control.joints, control.scale
    lower, upper, most = joints[_LOWER], joints[_UPPER], joints[_STEP]
    n, arm_dof = joints.shape[1], control.chain.shape[0] - 1
    if mode == _DELTA:
        for j in range(n):
            _move(targets, j, targets[j] + scale * action[j] * most[j], joints)
        return
    if mode == _PALM:
        _palm_step(action, targets, control)
    first = arm_dof if mode == _PALM else 0  # of the joints that an action says the places of
    for j in range(first, n):
        share = 0.5 * (action[len(action) - n + j] + 1.0)
        _move(targets, j, lower[j] + share * (upper[j] - lower[j]), joints)


@njit
def _move(targets: Array, j: int, desired: float, joints: Array) -> None:
    """Take one set-point towards a desired one, within the joint's velocity limit and range."""
    most = joints[_STEP, j]
    step = min(max(desired - targets[j], -most), most)
    targets[j] = min(max(targets[j] + step, joints[_LOWER, j]), joints[_UPPER, j])


@njit
def _palm_step(action: Array, targets: Array, control: Control) -> None:
    """Move the arm's set-points as the action moves the palm: damped least squares, home in the null space."""
    joints, share = control.joints, control.period / CONTROL_PERIOD
    n, scale = control.chain.shape[0] - 1, share * control.scale
    J, pull, residual = np.empty((6, n)), np.empty(n), np.empty(6)
    palm_jacobian(targets, control.chain, J)
    for j in range(n):
        pull[j] = share * _POSTURE_GAIN * (joints[_HOME, j] - targets[j])
    for r in range(6):
        residual[r] = scale * action[r] * (PALM_STEP if r < 3 else PALM_TURN)
        for j in range(n):
            residual[r] -= J[r, j] * pull[j]
    _solve(J, n, residual)
    excess = 1.0
    for j in range(n):
        for r in range(6):
            pull[j] += J[r, j] * residual[r]
        excess = max(excess, abs(pull[j]) / joints[_STEP, j])
    # One factor for all joints keeps the direction of the palm's motion.
    for j in range(n):
        _move(targets, j, targets[j] + pull[j] / excess, joints)


@njit
def palm_jacobian(targets: Array, chain: Array, J: Array) -> None:
    """Write the Jacobian of the palm (6, a) at arm positions: rows linear m and angular rad in the world frame."""
    n = chain.shape[0] - 1
    axes, anchors = np.empty((n, 3)), np.empty((n + 1, 3))
    qw, qx, qy, qz = 1.0, 0.0, 0.0, 0.0
    x, y, z = 0.0, 0.0, 0.0
    for j in range(n + 1):
        link = chain[j]
        dx, dy, dz = rotated((qw, qx, qy, qz), (link[0], link[1], link[2]))
        x, y, z = x + dx, y + dy, z + dz
        anchors[j, 0] = x
        anchors[j, 1] = y
        anchors[j, 2] = z
        qw, qx, qy, qz = product((qw, qx, qy, qz), (link[3], link[4], link[5], link[6]))
        if j < n:
            ax, ay, az = rotated((qw, qx, qy, qz), (0.0, 0.0, 1.0))
            axes[j, 0] = ax
            axes[j, 1] = ay
            axes[j, 2] = az
            half = 0.5 * targets[j]
            turn = (math.cos(half), 0.0, 0.0, math.sin(half))
            qw, qx, qy, qz = product((qw, qx, qy, qz), turn)
    for j in range(n):
        a, b, c = axes[j, 0], axes[j, 1], axes[j, 2]
        dx, dy, dz = x - anchors[j, 0], y - anchors[j, 1], z - anchors[j, 2]
        J[0, j] = b * dz - c * dy
        J[1, j] = c * dx - a * dz
        J[2, j] = a * dy - b * dx
        J[3, j] = a
        J[4, j] = b
        J[5, j] = c


@njit
def _solve(J: Array, n: int, x: Array) -> None:
    """Make b (6,) the x with (J Jt + d^2 I) x = b by Cholesky, which keeps to one order of operations; n columns."""
    L = np.empty((6, 6))
    for r in range(6):
        for c in range(r + 1):
            total = _DAMPING * _DAMPING if r == c else 0.0
            for j in range(n):
                total += J[r, j] * J[c, j]
            for k in range(c):
                total -= L[r, k] * L[c, k]
            L[r, c] = math.sqrt(total) if r == c else total / L[c, c]
    for r in range(6):
        for k in range(r):
            x[r] -= L[r, k] * x[k]
        x[r] /= L[r, r]
    for r in range(5, -1, -1):
        for k in range(r + 1, 6):
            x[r] -= L[k, r] * x[k]
        x[r] /= L[r, r]


@njit
def _command(e: Record, target: float, j: int, control: Control) -> float:
    """Return what the servo of a joint is to be told at the end of the control step: target and shaking."""
    command, joints, size = target, control.joints, control.size
    if control.kind == _SHAKEN and e.phase == _RUNNING:
        t = float(e.disturbed + 1) * control.period
        first, second = control.shaken[0], control.shaken[1]
        if j == first:
            command += size * 0.06 * math.sin(2.0 * math.pi * 3.0 * t)
        if j == second:
            command += size * 0.04 * (math.sin(2.0 * math.pi * 2.4 * t + 1.0) - math.sin(1.0))
        command = min(max(command, joints[_LOWER, j]), joints[_UPPER, j])
    return command


@njit
def _ramp(before: float, start: float, end: float, at: int, steps: int) -> float:
    """Return a joint's command in physics step `at` of `steps`: evenly from `start` to exactly `end`."""
    if at == steps:
        return end
    if at > 0:
        return start + at / steps * (end - start)
    if at == 0:
        return start
    return before + (steps + at) / steps * (start - before)


@njit
def _push(e: Record, control: Control, push: Array) -> None:
    for k in range(3):
        push[k] = 0.0
    lasts = control.push[0]
    turn, at = e.disturbed // (lasts + control.push[1]), e.disturbed % (lasts + control.push[1])
    if control.kind == _PUSHED and e.phase == _RUNNING and at < lasts:
        push[turn // 2] = control.size * e.mass * GRAVITY * (1.0 if turn % 2 == 0 else -1.0)
