"""Trials of a policy while it learns."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.spec import plan_trials
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.runs.epochs import Progress


@dataclass(frozen=True)
class Trials:
    """What a policy is tried on.

    Attributes:
        objects: names, expanded.
        number: of trials on each object.
        seed: of the scenes.
        every: epochs between; the last epoch is tried as well.
    """

    objects: tuple[str, ...]
    number: int = 1
    seed: int = 0
    every: int = 5


def due_success(folder: Path, trials: Trials | None, state: Progress) -> dict[str, Any]:
    """Return `success_rate` after an epoch after which the policy is to be tried, nothing after others."""
    if trials is None or (state.epoch % trials.every and state.epoch != state.epochs):
        return {}
    return success_rate(folder, trials)


def success_rate(folder: Path, trials: Trials) -> dict[str, Any]:
    """Return how many trials of the policy in a folder succeeded, under protocol `lift`."""
    settings = EvaluationSettings.of(
        [str(folder)], list(trials.objects), trials=trials.number, seed=trials.seed
    )
    runner = TrialRunner(settings)
    outcomes = [bool(runner.run(spec)[0]["success"]) for spec in plan_trials(settings)]
    runner.close()
    return {"success": sum(outcomes) / len(outcomes), "trials": len(outcomes)}
