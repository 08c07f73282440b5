"""Reinforcement in rounds, each from a seed of its own: what the trainings have in common.

A round depends on the learner's state and on its number alone, so that a training that was interrupted goes on to the
same bits: nothing of the environments has to be kept.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.imitation.trials import Trials, due_success
from dexgrasp.reinforcement.checkpoint import load_learner, save_learner
from dexgrasp.runs.epochs import Progress, progress_of, run_epochs
from dexgrasp.runs.folder import RunFolder
from dexgrasp_env.files import content_hash

RUN, CHECKPOINT = "training.json", "checkpoint.safetensors"
Report = Callable[[Progress], None] | None


class Rounds(ABC):
    """A training in its folder; who inherits makes `envs` and a `model` of Stable-Baselines3."""

    envs: Any
    model: Any

    def __init__(self, out: Path, settings: Any, base: Any) -> None:
        """Begin with nothing learned, of the clone `base` as `read_policy` returns it, or of none."""
        self.out, self.settings, self.base = out, settings, base
        self.state = Progress(epochs=settings.rounds)

    def run(self, trials: Trials | None, progress: Report, stop_after: int | None) -> Progress:
        """Go on to the last round."""
        path = self.out / CHECKPOINT
        found = load_learner(path, self.model)
        state = self.state = self.state if found is None else progress_of(found, path)
        judge = partial(due_success, self.out, trials, state)
        run_epochs(state, self.out, self._round, self._keep, progress, stop_after, judge)
        return state

    def _learn(self, steps: int) -> None:
        """Learn from some steps of the environments, begun anew from the round's seed."""
        words = np.random.SeedSequence([self.settings.seed, 1, self.state.epoch]).generate_state(1)
        self.model.set_random_seed(int(words[0]) >> 1)
        self.model._last_obs = None  # begin anew
        self.model.learn(steps, reset_num_timesteps=False, log_interval=None)

    def _keep(self) -> None:
        save_learner(self.out / CHECKPOINT, self.model, asdict(self.state))

    @abstractmethod
    def _round(self) -> dict[str, Any]:
        """Learn, write the policy, return the row of the curve."""

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()


def run_rounds(
    make: Callable[[Path, Any, Any], Rounds], out: Path, settings: Any, base: Any, trials: Trials | None,
    progress: Report, stop_after: int | None,
) -> Progress:  # fmt: skip
    """Claim `out` for a training that `make` makes, and run it."""
    hashed = None if base is None else content_hash(*(base[1][name] for name in sorted(base[1])))
    run = {
        "schema": 1, "clone": hashed, "settings": settings.as_json(),
        "trials": None if trials is None else asdict(trials),
    }  # fmt: skip
    claimed = RunFolder(out, RUN, "training").claim(run)
    with claimed, closing(make(out, settings, base)) as training:
        return training.run(trials, progress, stop_after)
