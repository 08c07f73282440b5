"""Evaluation of agents: runs the trials that are missing in a folder, and stores each as soon as it ends."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dexgrasp.agent import Agent, public_info
from dexgrasp.evaluation.replay import record
from dexgrasp.evaluation.settings import EvaluationSettings, TrialSpec, plan_trials, short_hash
from dexgrasp.evaluation.store import TrialStore, check_folder, failed_or_disturbed, row_key
from dexgrasp.evaluation.summary import bare_count, grouped, summarise
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.evaluation.video import VideoSettings, require_rendering
from dexgrasp.runs.interrupt import held
from dexgrasp.runs.pool import Backend, run_pool
from dexgrasp.runs.progress import progress_bar, warn
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand, write_json
from dexgrasp_env.objects.catalogue import CATALOGUE
from dexgrasp_env.objects.load import load_target
from dexgrasp_env.robot.cell import whole_path
from dexgrasp_env.valid import checked


@checked
def evaluate(
    settings: EvaluationSettings,
    folder: str | Path,
    *,
    backend: Backend = Backend(),
    videos: int | Literal["failures"] = 0,
    film: VideoSettings = VideoSettings(),
    progress: bool = True,
) -> Fields:
    """Run an evaluation, or what is missing of it, and return its summary (also `summary.json` in the folder).

    Args:
        settings: what to evaluate.
        folder: where trials.jsonl, summary.json and videos go; made if it is not there.
        backend: where trials run; the outcome does not depend on it.
        videos: number of trials of each agent and object to record, or "failures" for those that failed; recording
            makes a trial again, so that it can be asked for afterwards.
        film: what videos are taken with.
        progress: flag: show progress on standard error.

    Raises:
        InputError: for wrong settings, a mesh that cannot be used, or a folder that holds another evaluation.
        KeyboardInterrupt: as it comes; finished trials and their summary are kept.
        WorkerDiedError: likewise.
    """
    identity, folder = settings.identity(), expand(folder)
    check_folder(folder, identity)
    runner, planned = TrialRunner(settings), plan_trials(settings)
    _check(planned, runner)
    if videos:
        require_rendering()
    robot = settings.robot and whole_path(settings.robot)
    run = _EvaluationRun(planned, TrialStore(folder, identity, robot=robot), runner, backend, progress)
    if wrong := next(run.strange_rows(), None):
        run.store.close()
        raise InputError(f"{folder} holds {wrong}: choose another --out")
    try:
        run.play()
        run.record(videos, film)
    finally:
        summary = run.close()
    return summary


def _check(planned: Sequence[TrialSpec], runner: TrialRunner) -> None:
    """Check agents, settings, and every mesh before the first trial."""
    settings = runner.settings
    for target in settings.objects:
        if target not in CATALOGUE:
            load_target(target, settings.mesh_scale, settings.mesh_mass)
    first = {(spec.agent, spec.protocol): spec for spec in reversed(planned)}
    assumed = dict[str, str]()
    for spec in first.values():
        env, agent = runner.make_env(spec), runner.agent(spec)
        if isinstance(agent, Agent):
            agent.check_info(public_info(env, {}))
        env.close()
        assumed[spec.agent] = getattr(agent, "assumed", "")
    for words in filter(None, assumed.values()):
        warn(f"note: {words}")


@dataclass
class _EvaluationRun:
    """Evaluation in progress."""

    planned: Sequence[TrialSpec]
    store: TrialStore
    runner: TrialRunner
    backend: Backend
    progress: bool

    def strange_rows(self) -> Iterator[str]:
        """Yield words for stored trials of other settings, or of an agent whose files changed since it read them."""
        read = {(row["agent"], *file) for row in self.store.rows for file in row.get("files", {}).items()}
        for agent, name, digest in sorted(read):  # each once, as it may be large
            if not Path(name).is_file() or short_hash(Path(name)) != digest:
                yield f"trials of {agent}, which read {name} while it acted, and that has changed since"
        for key in set(map(row_key, self.store.rows)) - {spec.key for spec in self.planned}:
            yield f"a trial that is not of this evaluation ({', '.join(map(str, key))})"

    def play(self) -> None:
        """Run the trials that are not there."""
        left = [spec for spec in self.planned if spec.key not in self.store.finished]
        reported: set[tuple[str, str]] = set()
        with progress_bar("trial", "evaluate", shown=self.progress) as show:
            for row, grasp in run_pool(self.runner.run, left, self.backend):
                with held():
                    self.store.append(row, grasp)
                own = grouped(self.store.rows, "agent").items()
                won = {agent: "{successes}/{trials}".format(**bare_count(rows)) for agent, rows in own}
                show(len(self.store.rows), len(self.planned), **won)
                kind = row["agent"], row["reason"]
                if row["error"] and kind not in reported:  # all of them are in trials.jsonl
                    reported.add(kind)
                    warn(
                        f"{row['agent']} on {row['object']}, trial {row['trial']}: {row['reason']}\n"
                        f"{row['error'].rstrip()}"
                    )

    def record(self, videos: int | str, film: VideoSettings) -> None:
        """Record the first `videos` trials of each agent and object, or those that failed."""
        chosen = [
            row
            for row in self.store.rows
            if (failed_or_disturbed(row) if videos == "failures" else row["trial"] < int(videos))
        ]
        with progress_bar("video", "videos", shown=self.progress and bool(chosen)) as show:
            record(self.runner, chosen, self.store.folder, film, self.backend, show)

    def close(self) -> Fields:
        """Write and return the summary of the stored trials; release the folder and the environments."""
        with held():
            summary = summarise(self.runner.settings, self.store.rows)
            write_json(self.store.folder / "summary.json", summary)
            self.store.close()
            self.runner.close()
        return summary
