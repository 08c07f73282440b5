"""The trials that an evaluation consists of."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dexgrasp.evaluation.protocol import DEFAULT_PROTOCOL, TrialSeeds
from dexgrasp.evaluation.rows import Key
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.video import Film
from dexgrasp_env.objects.catalogue import CATALOGUE
from dexgrasp_env.objects.load import object_name


@dataclass(frozen=True)
class TrialSpec:
    """One trial to run.

    Attributes:
        agent: its name.
        target: the object, as `gym.make` takes it.
        label: the object, as people read it.
        trial: number from 0 on.
        protocol: its name.
        video: file to record to, or None.
        film: what it is taken with.
        seeds: of a trial that is made again; None for those that follow from the evaluation's.
    """

    agent: str
    target: str
    label: str
    trial: int
    protocol: str = DEFAULT_PROTOCOL
    video: str | None = None
    film: Film = Film()
    seeds: TrialSeeds | None = None

    @property
    def key(self) -> Key:
        """What tells the trial from the others of its evaluation."""
        return self.protocol, self.agent, self.label, self.trial


def plan_trials(settings: EvaluationSettings) -> list[TrialSpec]:
    """Return every trial of an evaluation, agent by agent, object by object, protocol by protocol."""
    labels = object_labels(settings.objects)
    return [
        TrialSpec(agent, target, labels[target], trial, protocol)
        for agent in settings.agents
        for target in settings.objects
        for protocol in settings.parts
        for trial in range(settings.trials)
    ]


def object_labels(targets: Sequence[str]) -> dict[str, str]:
    """Return what each object is called in the results: name or file's stem, the path where two are alike."""
    labels: dict[str, str] = {}
    for target in targets:
        label = object_name(target)
        if target not in CATALOGUE and (label in CATALOGUE or label in labels.values()):
            label = Path(target).name if Path(target).name not in labels.values() else target
        labels[target] = label
    return labels
