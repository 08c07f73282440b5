"""Demonstrations in the replay buffer of an off-policy algorithm of Stable-Baselines3."""

from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.data.demonstrations.resets import DemoResets
from dexgrasp.learning.reinforcement.env_record import attribute_of
from dexgrasp_env.errors import InputError


def add_demonstrations(model: Any, folder: str | Path) -> int:
    """Replay demonstrations in the environment of an algorithm and add the transitions to its replay buffer.

        model = SAC("MlpPolicy", gym.make("DexGrasp/LiftFromGrasp-v0"))
        add_demonstrations(model, "runs/demos")

    Args:
        model: algorithm with a `replay_buffer`, on environments of ours.
        folder: of `dexgrasp demos generate`.

    Returns:
        Number of transitions added.

    Raises:
        InputError: for another algorithm or environment, or where no demonstration succeeds in it.
    """
    buffer = getattr(model, "replay_buffer", None)
    if buffer is None:
        raise InputError(
            f"{type(model).__name__} has no replay buffer: valid are SAC, TD3, DDPG and the like"
        )
    twin = attribute_of(model.get_env(), "twin")
    if twin is None:
        raise InputError("demonstrations are of DexGrasp environments: this learner's is another")
    own = twin()
    added, resets = 0, DemoResets(folder)
    steps = resets.transitions(own)
    # The buffer takes as many at a time as there are environments.
    while len(rows := list(islice(steps, buffer.n_envs))) == buffer.n_envs:
        before, after, actions, rewards, ends = (_stacked(part) for part in zip(*rows, strict=True))
        buffer.add(before, after, actions, rewards, ends, [{} for _ in rows])
        added += len(rows)
    own.close()
    if not added:
        raise InputError("no demonstration succeeds in this environment: give those of its objects")
    return added


def _stacked(values: Any) -> Any:
    if isinstance(values[0], dict):
        return {key: np.stack([value[key] for value in values]) for key in values[0]}
    return np.stack(values)
