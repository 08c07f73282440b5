"""Reward terms, each in [0, 1], as functions of arrays with leading batch axes."""

import numpy as np
from dm_control.utils.rewards import tolerance
from numpy.typing import NDArray

from dexgrasp_env.lift.constants import HOLD_STEPS, LIFT_HEIGHT
from dexgrasp_env.lift.state import Array, LiftState, ObjectConstants
from dexgrasp_env.lift.success import Progress
from dexgrasp_env.poses import components

REWARD_MODES = ("dense", "sparse")
WEIGHTS = {"reach": 0.2, "contact": 0.2, "lift": 0.3, "hold": 0.3}
_GRASP_FINGERS = [3, 0, 1]  # thumb, index, middle among index, middle, ring, thumb
_FIRM = 1.0  # N: a fingertip force that counts as contact


def reward_terms(state: LiftState, progress: Progress, constants: ObjectConstants) -> dict[str, Array]:
    """Return the terms of `WEIGHTS`, each (...,) in [0, 1]."""
    distance = _tip_distances(state, constants)
    forces = np.sqrt((state.tip_forces**2).sum(-1))
    near = tolerance(distance, bounds=(0.0, 0.02), margin=0.3, sigmoid="long_tail")
    index, middle, _, thumb = components(np.minimum(forces / _FIRM, 1.0))
    return {
        "reach": near.sum(-1) / len(_GRASP_FINGERS),
        # The thumb must oppose: two fingers on one side do not hold.
        "contact": np.minimum(thumb, np.maximum(index, middle)),
        "lift": np.minimum(np.maximum(progress.height / LIFT_HEIGHT, 0.0), 1.0) * state.touched_by_hand,
        "hold": np.minimum(progress.held_steps / HOLD_STEPS, 1.0),
    }


def dense_reward(terms: dict[str, Array]) -> Array:
    """Weighted sum (...,) of the terms, in [0, 1]."""
    return sum((WEIGHTS[name] * terms[name] for name in WEIGHTS), start=np.zeros(()))


def sparse_reward(progress: Progress) -> NDArray[np.float64]:
    """1 while the task is solved, else 0."""
    return progress.is_success.astype(float)


def _tip_distances(state: LiftState, constants: ObjectConstants) -> Array:
    """Distance (..., 3) m of thumb, index and middle tip centres to the object's box."""
    offset = state.tip_positions[..., _GRASP_FINGERS, :] - state.object_position[..., None, :]
    local = (offset[..., None] * state.object_rotation[..., None, :, :]).sum(-2)
    outside = np.maximum(np.abs(local) - 0.5 * constants.extents[..., None, :], 0.0)
    return np.sqrt((outside**2).sum(-1))
