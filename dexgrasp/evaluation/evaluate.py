"""Every agent on every object: what is not there yet is run, and each trial is kept as soon as it ends."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

from dexgrasp.evaluation.replay import record
from dexgrasp.evaluation.sequential import decided_after
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.spec import TrialSpec, plan_trials
from dexgrasp.evaluation.store import Key, TrialStore, check_folder
from dexgrasp.evaluation.summary import summarise
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.evaluation.video import Film, check_rendering
from dexgrasp.evaluation.workers import Backend, LostTrialsError, run_cells
from dexgrasp.runs.interrupt import held, kept
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.catalogue import CATALOGUE
from dexgrasp_env.objects.load import load_target


def evaluate(
    settings: EvaluationSettings,
    folder: Path,
    *,
    workers: int | Backend = 1,
    videos: int | Literal["failures"] = 0,
    film: Film = Film(),
    progress: bool = True,
    stop_level: float | None = None,
) -> dict[str, Any]:
    """Run an evaluation, or what is missing of it, and return its summary (also `summary.json` in the folder).

    Args:
        settings: what to evaluate.
        folder: where trials.jsonl, summary.json and videos go; made if it is not there.
        workers: processes, or where else trials run; the outcome does not depend on it.
        videos: how many trials of each agent and object are recorded, or "failures" for those that failed; recording
            makes a trial again, so that it may be asked for after the fact.
        film: what videos are taken with.
        progress: whether to draw a progress bar on standard error.
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
    backend = workers if isinstance(workers, Backend) else Backend(workers=workers)
    check_folder(folder, settings.identity())
    bench = TrialRunner(settings)
    planned = plan_trials(settings)
    _check(settings, planned, bench)
    if videos:
        check_rendering()
    store = TrialStore(folder, settings.identity())
    _check_rows(store, planned)
    if stop_level is not None:  # round by round, so that it can stop between rounds
        planned = sorted(planned, key=lambda cell: cell.trial)
    keys = [(cell.agent, cell.label, cell.trial) for cell in planned]

    def stopped_after() -> int | None:
        return None if stop_level is None else decided_after(keys, store.rows, settings.agents, stop_level)

    cells = [cell for cell in planned if _key(cell) not in store.finished]
    try:
        if stopped_after() is None:
            with kept():
                _run(settings, cells, store, backend, bench, progress, stopped_after)
        if videos:
            with kept():
                _record(settings, store, videos, film, backend, bench, progress)
    finally:
        with held():
            summary = summarise(settings, store.rows, stopped_after=stopped_after(), stop_level=stop_level)
            store.write_json("summary.json", summary)
            store.close()
            bench.close()
    return summary


def _check(settings: EvaluationSettings, planned: Sequence[TrialSpec], bench: TrialRunner) -> None:
    """Let mistakes show before the first trial: agents, settings, and every mesh."""
    for target in settings.objects:
        if target not in CATALOGUE:
            load_target(target, settings.mesh_scale, settings.mesh_mass)
    first = {(spec.agent, spec.protocol): spec for spec in reversed(planned)}
    for spec in first.values():
        bench.make_env(spec).close()


def _check_rows(store: TrialStore, planned: Sequence[TrialSpec]) -> None:
    known = {_key(spec) for spec in planned}
    for key in store.finished - known:
        store.close()
        raise InputError(
            f"{store.folder} holds a trial that is not of this evaluation ({', '.join(map(str, key))}): "
            "choose another --out"
        )


def _record(
    settings: EvaluationSettings,
    store: TrialStore,
    videos: int | str,
    film: Film,
    backend: Backend,
    bench: TrialRunner,
    progress: bool,
) -> None:
    from tqdm import tqdm

    chosen = [
        row
        for row in store.rows
        if (not row["success"] if videos == "failures" else row["trial"] < int(videos))
    ]
    shown = record(settings, chosen, store.folder, film, backend, bench)
    for _ in tqdm(shown, desc="videos", unit="video", disable=not progress, file=sys.stderr):
        pass


def _key(spec: TrialSpec) -> Key:
    return spec.protocol, spec.agent, spec.label, spec.trial


def _run(
    settings: EvaluationSettings,
    cells: Sequence[TrialSpec],
    store: TrialStore,
    backend: Backend,
    bench: TrialRunner,
    progress: bool,
    stopped_after: Callable[[], int | None],
) -> None:
    from tqdm import tqdm

    done = len(store.rows)
    interval = 0.2 if sys.stderr.isatty() else 10.0  # seconds; a log file wants fewer lines
    with tqdm(
        total=done + len(cells),
        initial=done,
        disable=not progress,
        unit="trial",
        file=sys.stderr,
        mininterval=interval,
    ) as bar:
        errors: set[tuple[str, str]] = set()
        for row, grasp in run_cells(settings, cells, backend, bench):
            with held():
                store.append(row, grasp)
            bar.set_postfix_str(_success_so_far(store.rows), refresh=False)
            bar.update()
            _warn_once(row, errors)
            if stopped_after() is not None:
                return
    lost = {_key(cell) for cell in cells} - store.finished
    if lost:
        first = ", ".join(map(str, min(lost)))
        raise LostTrialsError(f"{len(lost)} of {done + len(cells)} trials did not finish, the first: {first}")


def _success_so_far(rows: Sequence[dict[str, Any]]) -> str:
    agents = dict.fromkeys(row["agent"] for row in rows)
    counts = {agent: [row["success"] for row in rows if row["agent"] == agent] for agent in agents}
    return ", ".join(f"{agent} {sum(won)}/{len(won)}" for agent, won in counts.items())


def _warn_once(row: dict[str, Any], seen: set[tuple[str, str]]) -> None:
    """Print an agent's error the first time that it comes up; all of them are in trials.jsonl."""
    kind = (row["agent"], row["reason"] or "")
    if row["error"] and kind not in seen:
        seen.add(kind)
        warn(
            f"{row['agent']} on {row['object']}, trial {row['trial']}: {row['reason']}\n{row['error'].rstrip()}"
        )


def warn(text: str) -> None:
    """Print on standard error without spoiling a progress bar."""
    from tqdm import tqdm

    tqdm.write(text, file=sys.stderr)
