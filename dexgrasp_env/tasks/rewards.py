"""Reward terms, each in [0, 1], as functions of arrays with leading batch axes."""

from typing import Any

from dexgrasp_env.tasks.arithmetic import excess, least, most, root
from dexgrasp_env.tasks.constants import HOLD_STEPS, LIFT_HEIGHT
from dexgrasp_env.tasks.state import LiftState, ObjectConstants
from dexgrasp_env.tasks.success import Progress

REWARD_MODES = ("dense", "sparse")
WEIGHTS = {"reach": 0.2, "contact": 0.2, "lift": 0.3, "hold": 0.3}
_GRASP_TIPS = (9, 0, 3)  # where thumb, index and middle begin among index, middle, ring, thumb
_NEAR, _FAR = 0.02, 0.3  # m
_TAIL = 3.0  # sqrt(1 / 0.1 - 1)
_FIRM = 1.0  # N: a fingertip force that counts as contact


def reward_terms(state: LiftState, progress: Progress, constants: ObjectConstants) -> dict[str, Any]:
    """Return the terms of `WEIGHTS`, each (...,) in [0, 1]."""
    near = [_nearness(distance) for distance in _tip_distances(state, constants)]
    thumb, index, middle = _tip_pressure(state)
    return {
        "reach": (near[0] + near[1] + near[2]) / 3.0,
        # The thumb must oppose: two fingers on one side do not hold.
        "contact": least(thumb, most(index, middle)),
        "lift": least(most(progress.height / LIFT_HEIGHT, 0.0), 1.0) * state.touched_by_hand,
        "hold": least(progress.held_steps / HOLD_STEPS, 1.0),
    }


def dense_reward(terms: dict[str, Any]) -> Any:
    """Weighted sum (...,) of the terms, in [0, 1]."""
    return sum(WEIGHTS[name] * terms[name] for name in WEIGHTS)


def sparse_reward(progress: Progress) -> Any:
    """1 while the task is solved, else 0."""
    return 1.0 * progress.is_success


def _nearness(distance: Any) -> Any:
    """1 up to 2 cm, 0.1 at 30 cm beyond, with a long tail.

    This is `dm_control.utils.rewards.tolerance(distance, (0, 0.02), 0.3, "long_tail")` on plain numbers; a test holds
    the two together.
    """
    x = _TAIL * excess(distance - _NEAR) / _FAR
    return 1.0 / (x * x + 1.0)


def _tip_distances(state: LiftState, constants: ObjectConstants) -> list[Any]:
    """Distances (...,) m of thumb, index and middle tip centres to the object's box."""
    tips = state.readings[state.sensors.tip_positions]
    x, y, z = state.configuration[23:26]
    xx, xy, xz, yx, yy, yz, zx, zy, zz = state.object_rotation
    half_x, half_y, half_z = constants.half_extents
    distances = []
    for first in _GRASP_TIPS:
        a, b, c = tips[first] - x, tips[first + 1] - y, tips[first + 2] - z
        out_x = excess(abs(a * xx + b * yx + c * zx) - half_x)
        out_y = excess(abs(a * xy + b * yy + c * zy) - half_y)
        out_z = excess(abs(a * xz + b * yz + c * zz) - half_z)
        distances.append(root(out_x * out_x + out_y * out_y + out_z * out_z))
    return distances


def _tip_pressure(state: LiftState) -> list[Any]:
    """Contact forces (...,) of thumb, index and middle over what counts as firm, at most 1."""
    forces = state.readings[state.sensors.tip_forces]
    triples = [forces[first : first + 3] for first in _GRASP_TIPS]
    return [least(root(x * x + y * y + z * z) / _FIRM, 1.0) for x, y, z in triples]
