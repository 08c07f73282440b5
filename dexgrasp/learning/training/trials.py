"""Periodic trials of a policy during its training."""

from dataclasses import dataclass
from pathlib import Path

from dexgrasp.evaluation.settings import EvaluationSettings, plan_trials
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp_env.arrays import Fields


@dataclass(frozen=True)
class PeriodicTrials:
    """Evaluation of a policy under protocol `lift` every few epochs.

    Attributes:
        objects: names, expanded.
        number: of trials on each object.
        seed: of the scenes.
        every: epochs from trial to trial; there is one after the last epoch as well.
    """

    objects: tuple[str, ...]
    number: int = 1
    seed: int = 0
    every: int = 5

    def after(self, folder: Path, epoch: int, epochs: int) -> Fields:
        """Return the success rate after an epoch in which trials are due; {} after others."""
        if epoch % self.every and epoch != epochs:
            return {}
        settings = EvaluationSettings.of([str(folder)], self.objects, trials=self.number, seed=self.seed)
        runner = TrialRunner(settings)
        outcomes = [bool(runner.run(spec)[0]["success"]) for spec in plan_trials(settings)]
        runner.close()
        return {"success": sum(outcomes) / len(outcomes), "trials": len(outcomes)}
