"""The tasks' arithmetic, compiled: state and sensors to progress, reward and observation.

Every function goes through the rows of contiguous arrays, one an environment; a single environment is one row, so one
and many give the same bits. This module imports numba: it is imported when an environment is made.
"""

import math

from dexgrasp_env.arrays import Array, Index, Single
from dexgrasp_env.compiled import njit
from dexgrasp_env.poses import product_components, rotated_components, rotation_components
from dexgrasp_env.tasks.constants import (
    DISTURB_SHIFT,
    GRASP_FORCE,
    LIFT_HEIGHT,
    OFF_TABLE,
    STABLE_SLIP,
    STABLE_TILT,
    WORKSPACE_HIGH,
    WORKSPACE_LOW,
)
from dexgrasp_env.tasks.records import (
    FAILURES,
    PALM,
    PALM_QUAT,
    PHASES,
    PRESSES,
    STAGES,
    TIP_FORCES,
    TIPS,
    TOUCHING_ANY,
    TOUCHING_HAND,
    Record,
    Records,
    Rules,
)
from dexgrasp_env.tasks.reward_terms import length, reward_terms
from dexgrasp_env.tasks.simulation import PhysicsState

product = njit(product_components)
rotated = njit(rotated_components)
_rotation = njit(rotation_components)

_UNTOUCHED, _TOUCHED, _LIFTED, _DROPPED, _HELD = range(len(STAGES))
_NO_FAILURE, _LOST, _DIVERGED = range(len(FAILURES))
_NO_PHASE, _BEFORE, _RUNNING, _OVER = range(len(PHASES))

_X0, _Y0, _Z0 = WORKSPACE_LOW
_X1, _Y1, _Z1 = WORKSPACE_HIGH


@njit
def _judge(e: Record, q: Array, v: Array, s: Array, warnings: int, rules: Rules) -> float:
    """Advance what an episode has achieved by the control step just taken, and return the reward.

    Args:
        e: the episode.
        q: positions (n + 7 k,).
        v: velocities (n + 6 k,).
        s: `sensordata`.
        warnings: bits of MuJoCo's that came up in the control step.
        rules: of the environment.
    """
    at, n = rules.at, rules.joints
    pose = q[n : n + 7]
    e.warnings |= warnings
    _fail(e, q, v, pose, rules.bad_numbers)
    R = _rotation(pose[3], pose[4], pose[5], pose[6])
    e.height = _lowest_point(e, pose, R, rules.hulls)
    touching, alone = s[at[TOUCHING_HAND]] > 0.0, s[at[TOUCHING_HAND]] == s[at[TOUCHING_ANY]]
    e.touched = e.touched or touching
    e.grasped = _opposed(s, at[PRESSES], rules)
    at_height = e.height >= LIFT_HEIGHT and touching and alone
    if at_height:
        _hold_on(e, rules.hold)
    else:
        _hold_anew(e)
    e.lifted = e.lifted or at_height
    inverse = (s[at[PALM_QUAT]], -s[at[PALM_QUAT] + 1], -s[at[PALM_QUAT] + 2], -s[at[PALM_QUAT] + 3])
    palm = at[PALM]
    position = rotated(inverse, (pose[0] - s[palm], pose[1] - s[palm + 1], pose[2] - s[palm + 2]))
    quat = product(inverse, (pose[3], pose[4], pose[5], pose[6]))
    _follow_grip(e, position, quat, touching and alone)
    _disturb(e, position, rules)
    _conclude(e, rules)
    e.progress[0], e.progress[1] = e.height, min(e.held / rules.hold, 1.0)
    e.stable = e.airborne and e.slip < STABLE_SLIP and e.tilt < STABLE_TILT
    return _reward(e, pose, R, s, rules)


@njit
def _reward(e: Record, pose: Array, R: tuple[float, ...], s: Array, rules: Rules) -> float:
    """Write the terms, and return the reward of the control step."""
    reward_terms(e, pose, R, s, rules, e.terms)
    total = 0.0
    for k in range(len(rules.weights)):
        total += rules.weights[k] * e.terms[k]
    if rules.best:
        total = max(total, e.total)
    gain = total - e.total
    e.total = total
    if not rules.dense:
        return 1.0 if e.success and e.failure != _DIVERGED else 0.0
    return gain


@njit
def _fail(e: Record, q: Array, v: Array, pose: Array, bad_numbers: int) -> None:
    finite = True
    for k in range(len(q)):
        finite = finite and math.isfinite(q[k])
    for k in range(len(v)):
        finite = finite and math.isfinite(v[k])
    if not finite or e.warnings & bad_numbers != 0:
        e.failure = _DIVERGED
    elif not (_X0 <= pose[0] <= _X1 and _Y0 <= pose[1] <= _Y1 and _Z0 <= pose[2] <= _Z1):
        e.failure = _LOST
    else:
        e.failure = _NO_FAILURE


@njit
def _lowest_point(e: Record, pose: Array, R: tuple[float, ...], hulls: Array) -> float:
    """Height of the object's lowest point above the table, m."""
    lowest = math.inf
    for k in range(e.hull_first, e.hull_first + e.hull_count):
        lowest = min(lowest, hulls[k, 0] * R[6] + hulls[k, 1] * R[7] + hulls[k, 2] * R[8])
    return pose[2] + e.size * lowest


@njit
def _opposed(s: Array, first: int, rules: Rules) -> bool:
    """Test for a grasp: thumb and another finger press with 0.5 N each, at more than 90 deg to each other."""
    thumb = first + 3 * rules.grasp[0]
    tx, ty, tz = s[thumb], s[thumb + 1], s[thumb + 2]
    if length(tx, ty, tz) < GRASP_FORCE:
        return False
    for finger in range(rules.fingers):
        if finger == rules.grasp[0]:
            continue
        x, y, z = s[first + 3 * finger], s[first + 3 * finger + 1], s[first + 3 * finger + 2]
        if length(x, y, z) >= GRASP_FORCE and x * tx + y * ty + z * tz < 0.0:
            return True
    return False


@njit
def _follow_grip(
    e: Record, position: tuple[float, ...], quat: tuple[float, ...], alone_in_hand: bool
) -> None:
    """Note where the object was in the hand when it left the table, and the largest motion since."""
    airborne = e.height > OFF_TABLE and alone_in_hand
    if airborne and not e.airborne:
        for k in range(3):
            e.grip_position[k] = position[k]
        for k in range(4):
            e.grip_quat[k] = quat[k]
    e.airborne = airborne
    if not airborne:
        e.slip = e.tilt = 0.0
        return
    g = e.grip_quat
    w, x, y, z = product((g[0], -g[1], -g[2], -g[3]), quat)
    e.slip = max(e.slip, _distance(position, e.grip_position))
    e.tilt = max(e.tilt, 2.0 * math.atan2(length(x, y, z), abs(w)))


@njit
def _distance(a: tuple[float, ...], b: Array) -> float:
    return length(a[0] - b[0], a[1] - b[1], a[2] - b[2])


@njit
def _hold_on(e: Record, hold: int) -> None:
    """Count a control step of the hold, and the grasps among the last `hold` of them."""
    slot = e.held % hold
    e.grasps += int(e.grasped) - int(e.window[slot])
    e.window[slot] = e.grasped
    e.held += 1


@njit
def _hold_anew(e: Record) -> None:
    if e.held > 0:
        e.window[:] = 0
    e.held = e.grasps = 0


@njit
def _disturb(e: Record, position: tuple[float, ...], rules: Rules) -> None:
    """Begin the disturbance once the object has been held for 1 s; the hold counts anew when it is over."""
    if e.phase == _RUNNING or e.phase == _OVER:
        e.shift = max(e.shift, _distance(position, e.origin))
    if e.phase == _RUNNING:
        e.disturbed += 1
        if e.disturbed == rules.length:
            e.phase = _OVER
            _hold_anew(e)
    elif e.phase == _BEFORE and e.held >= rules.wait:
        e.phase = _RUNNING
        for k in range(3):
            e.origin[k] = position[k]


@njit
def _conclude(e: Record, rules: Rules) -> None:
    """Update success and stage."""
    undisturbed = e.phase == _NO_PHASE or (e.phase == _OVER and e.shift <= DISTURB_SHIFT)
    e.success = undisturbed and e.held >= rules.hold and e.grasped and e.grasps >= rules.grasped
    e.solved = e.solved or e.success
    if e.success:
        e.stage = _HELD
    elif e.lifted:
        e.stage = _LIFTED if e.held > 0 else _DROPPED
    else:
        e.stage = _TOUCHED if e.touched else _UNTOUCHED


@njit
def _observe(
    e: Record, q: Array, v: Array, s: Array, targets: Array, noise: Array, rules: Rules, o: Single
) -> None:
    """Write what the robot knows of itself, and where there is room for it what no camera tells.

    Args:
        e: the episode.
        q: positions (n + 7 k,).
        v: velocities (n + 6 k,).
        s: `sensordata`.
        targets: (n,) set-points, rad.
        noise: (n,) rad, or (0,) for none.
        rules: of the environment.
        o: (m,) out, in the order of `observations.key_sizes`; where physics has diverged 0 for what is no number.
    """
    n, tips, palm = rules.joints, rules.at[TIPS], rules.at[PALM]
    own = 3 * n + 3 * rules.fingers
    for j in range(n):
        o[j] = q[j] + noise[j] if len(noise) > 0 else q[j]
        o[n + j] = v[j]
        o[2 * n + j] = targets[j]
    for j in range(own - 3 * n):
        o[3 * n + j] = s[tips + j]
    for j in range(7):
        o[own + j] = s[palm + j]  # the quaternion's reading follows the position's
    if len(o) > own + 7:
        _observe_object(e, q[n:], v[n:], s[rules.at[TIP_FORCES] :], own - 3 * n, o[own + 7 :])
    if e.failure == _DIVERGED:
        for j in range(len(o)):
            o[j] = o[j] if math.isfinite(o[j]) else 0.0


@njit
def _observe_object(e: Record, q: Array, v: Array, forces: Array, tips: int, o: Single) -> None:
    for j in range(7):
        o[j] = q[j]
    for j in range(6):
        o[7 + j] = v[j]
    for j in range(3):
        o[13 + j] = 2.0 * e.half_extents[j]
    o[16] = e.mass
    for j in range(tips):
        o[17 + j] = forces[j]
    for j in range(2):
        o[17 + tips + j] = e.progress[j]
    for j in range(6):
        o[19 + tips + j] = e.variation[j]


@njit
def conclude(
    episodes: Records, now: PhysicsState, warnings: Index, commands: Array, noise: Array, rules: Rules,
    rewards: Array, seen: Single, judge: bool,
) -> None:  # fmt: skip
    """Advance what the episodes have achieved by the control step just taken, reward and observe them.

    Args:
        episodes: (N,); their progress is advanced.
        now: their physics; quaternions wxyz, the target is the first object.
        warnings: (N,) bits of MuJoCo's that came up in the control step.
        commands: (N, 3, n) rad, `COMMANDS`.
        noise: (N, n) rad, of the joint position sensors, or (N, 0) for none.
        rules: of the environment.
        rewards: (N,) out.
        seen: (N, m) out, see `_observe`.
        judge: False to observe alone.
    """
    qpos, qvel, sensors = now
    for i in range(len(episodes)):
        e, q, v, s = episodes[i], qpos[i], qvel[i], sensors[i]
        if judge:
            rewards[i] = _judge(e, q, v, s, warnings[i], rules)
        _observe(e, q, v, s, commands[i, 0], noise[i], rules, seen[i])
