"""Every agent on every object: what is not there yet is run, and each trial is kept as soon as it ends."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dexgrasp.evaluation.replay import record
from dexgrasp.evaluation.sequential import decided_after
from dexgrasp.evaluation.settings import EvaluationSettings, TrialSpec, plan_trials
from dexgrasp.evaluation.store import TrialStore, check_folder, fell_short
from dexgrasp.evaluation.summary import bare_count, grouped, summarise
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.evaluation.video import Film, check_rendering
from dexgrasp.runs.interrupt import held, kept
from dexgrasp.runs.pool import Backend, run_pool
from dexgrasp.runs.progress import progress_bar, warn
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_json
from dexgrasp_env.objects.catalogue import CATALOGUE
from dexgrasp_env.objects.load import load_target


class LostTrialsError(RuntimeError):
    """Fewer trials finished than were asked for, though nothing said so."""


def evaluate(
    settings: EvaluationSettings,
    folder: Path,
    *,
    backend: Backend = Backend(),
    videos: int | Literal["failures"] = 0,
    film: Film = Film(),
    progress: bool = True,
    stop_level: float | None = None,
) -> Fields:
    """Run an evaluation, or what is missing of it, and return its summary (also `summary.json` in the folder).

    Args:
        settings: what to evaluate.
        folder: where trials.jsonl, summary.json and videos go; made if it is not there.
        backend: where trials run; the outcome does not depend on it.
        videos: how many trials of each agent and object are recorded, or "failures" for what fell short; recording
            makes a trial again, so that it may be asked for after the fact.
        film: what videos are taken with.
        progress: whether to say on standard error how far it is.
        stop_level: end as soon as every pair of agents is told apart at this level, by the test of `sequential`; the
            summary then is of the whole rounds up to there. None runs every trial.

    Raises:
        InputError: for wrong settings, a mesh that cannot be used, or a folder that holds another evaluation.
        KeyboardInterrupt: as it comes; finished trials and their summary are kept.
        WorkerDiedError: likewise.
        LostTrialsError: likewise, where fewer trials finished than were asked for.
    """
    if stop_level is not None and len(settings.parts) > 1:
        raise InputError("--stop-early tells agents apart under one protocol: name one")
    identity = settings.identity()
    check_folder(folder, identity)
    runner, planned = TrialRunner(settings), plan_trials(settings)
    _check(planned, runner)
    if videos:
        check_rendering()
    if stop_level is not None:  # round by round, so that it can stop between rounds
        planned.sort(key=lambda spec: spec.trial)
    run = _Run(
        planned,
        TrialStore(folder, identity, robot=settings.robot_path),
        runner,
        backend,
        progress,
        stop_level,
    )
    run.check_rows()
    try:
        with kept():
            run.play()
            run.record(videos, film)
    finally:
        summary = run.close()
    return summary


def _check(planned: Sequence[TrialSpec], runner: TrialRunner) -> None:
    """Let mistakes show before the first trial: agents, settings, and every mesh."""
    settings = runner.settings
    for target in settings.objects:
        if target not in CATALOGUE:
            load_target(target, settings.mesh_scale, settings.mesh_mass)
    first = {(spec.agent, spec.protocol): spec for spec in reversed(planned)}
    for spec in first.values():
        runner.make_env(spec).close()


@dataclass
class _Run:
    """An evaluation that goes on."""

    planned: Sequence[TrialSpec]
    store: TrialStore
    runner: TrialRunner
    backend: Backend
    progress: bool
    stop_level: float | None

    def check_rows(self) -> None:
        """Refuse trials of something else.

        Raises:
            InputError: naming one.
        """
        for key in self.store.finished - {spec.key for spec in self.planned}:
            self.store.close()
            raise InputError(
                f"{self.store.folder} holds a trial that is not of this evaluation ({', '.join(map(str, key))}): "
                "choose another --out"
            )

    def play(self) -> None:
        """Run the trials that are not there, unless it is decided before."""
        if self._stopped_after() is not None:
            return
        left = [spec for spec in self.planned if spec.key not in self.store.finished]
        told: set[tuple[str, str]] = set()
        with progress_bar("trial", "evaluate", shown=self.progress) as show:
            for row, grasp in run_pool(self.runner.run, left, self.backend):
                with held():
                    self.store.append(row, grasp)
                own = grouped(self.store.rows, "agent").items()
                won = {agent: "{successes}/{trials}".format(**bare_count(rows)) for agent, rows in own}
                show(len(self.store.rows), len(self.planned), **won)
                kind = row["agent"], row["reason"]
                if row["error"] and kind not in told:  # each the first time; all of them are in trials.jsonl
                    told.add(kind)
                    warn(
                        f"{row['agent']} on {row['object']}, trial {row['trial']}: {row['reason']}\n"
                        f"{row['error'].rstrip()}"
                    )
                if self._stopped_after() is not None:
                    return
        if lost := {spec.key for spec in left} - self.store.finished:
            raise LostTrialsError(
                f"{len(lost)} of {len(self.planned)} trials did not finish, the first: {', '.join(map(str, min(lost)))}"
            )

    def record(self, videos: int | str, film: Film) -> None:
        """Record the first so many trials of each agent and object, or those that failed."""
        chosen = [
            row
            for row in self.store.rows
            if (fell_short(row) if videos == "failures" else row["trial"] < int(videos))
        ]
        with progress_bar("video", "videos", shown=self.progress and bool(chosen)) as show:
            record(self.runner, chosen, self.store.folder, film, self.backend, show)

    def close(self) -> Fields:
        """Sum up what is there, and let go of it."""
        with held():
            summary = summarise(
                self.runner.settings, self.store.rows,
                stopped_after=self._stopped_after(), stop_level=self.stop_level,
            )  # fmt: skip
            write_json(self.store.folder / "summary.json", summary)
            self.store.close()
            self.runner.close()
        return summary

    def _stopped_after(self) -> int | None:
        if self.stop_level is None:
            return None
        keys = [spec.key[1:] for spec in self.planned]
        return decided_after(keys, self.store.rows, self.runner.settings.agents, self.stop_level)
