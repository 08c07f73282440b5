"""Every agent on every object: what is not there yet is run, and each trial is kept as soon as it ends."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from agents.evaluation.sequential import decided_after
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.store import TrialStore
from agents.evaluation.summary import summarise
from agents.evaluation.trial_runner import TrialRunner, TrialSpec
from agents.evaluation.video import check_rendering
from agents.evaluation.workers import run_cells
from agents.interrupt import held, kept
from dexgrasp_env.objects.catalogue import CATALOGUE


def evaluate(
    settings: EvaluationSettings,
    folder: Path,
    *,
    workers: int = 1,
    videos: int = 0,
    progress: bool = True,
    stop_level: float | None = None,
) -> dict[str, Any]:
    """Run an evaluation, or what is missing of it, and return its summary (also `summary.json` in the folder).

    Args:
        settings: what to evaluate.
        folder: where trials.jsonl, summary.json and videos go; made if it is not there.
        workers: processes.
        videos: how many trials of each agent and object are recorded.
        progress: whether to draw a progress bar on standard error.
        stop_level: end as soon as every pair of agents is told apart at this level, by the test of `sequential`; the
            summary then is of the whole rounds up to there. None runs every trial.

    Raises:
        InputError: for wrong settings, or a folder that holds another evaluation.
        KeyboardInterrupt: as it comes; finished trials and their summary are kept.
        WorkerDiedError: likewise.
    """
    bench = TrialRunner(settings)
    for agent in settings.agents:  # mistakes show before the first trial
        bench.make_env(agent, settings.objects[0]).close()
    if videos:
        check_rendering()
    store = TrialStore(folder, settings.identity())
    planned = plan_cells(settings, folder, videos)
    if stop_level is not None:
        planned = sorted(
            planned, key=lambda cell: cell.trial
        )  # round by round, so that it can stop between rounds
    keys = [_key(cell) for cell in planned]

    def stopped_after() -> int | None:
        return None if stop_level is None else decided_after(keys, store.rows, settings.agents, stop_level)

    cells = [cell for cell in planned if _key(cell) not in store.finished]
    try:
        if stopped_after() is None:
            with kept():
                _run(settings, cells, store, workers, bench, progress, stopped_after)
    finally:
        with held():
            summary = summarise(settings, store.rows, stopped_after=stopped_after(), stop_level=stop_level)
            store.write_json("summary.json", summary)
            store.close()
            bench.close()
    return summary


def plan_cells(settings: EvaluationSettings, folder: Path, videos: int) -> list[TrialSpec]:
    """Return every trial of an evaluation, agent by agent and object by object."""
    labels = object_labels(settings.objects)

    def video(agent: str, label: str, trial: int) -> str | None:
        name = f"{agent}-{label}-{trial}.mp4".replace("/", "_").replace(":", ".")
        return str(folder / "videos" / name) if trial < videos else None

    return [
        TrialSpec(agent, target, labels[target], trial, video(agent, labels[target], trial))
        for agent in settings.agents
        for target in settings.objects
        for trial in range(settings.trials)
    ]


def object_labels(targets: Sequence[str]) -> dict[str, str]:
    """Return what each object is called in the results: name or file's stem, the path where two are alike."""
    labels: dict[str, str] = {}
    for target in targets:
        label = target if target in CATALOGUE else Path(target).stem
        if target not in CATALOGUE and (label in CATALOGUE or label in labels.values()):
            label = Path(target).name if Path(target).name not in labels.values() else target
        labels[target] = label
    return labels


def _key(cell: TrialSpec) -> tuple[str, str, int]:
    return cell.agent, cell.label, cell.trial


def _run(
    settings: EvaluationSettings,
    cells: Sequence[TrialSpec],
    store: TrialStore,
    workers: int,
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
        for row in run_cells(settings, cells, workers, bench):
            with held():
                store.append(row)
            bar.set_postfix_str(_success_so_far(store.rows), refresh=False)
            bar.update()
            _warn_once(row, errors)
            if stopped_after() is not None:
                return


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
