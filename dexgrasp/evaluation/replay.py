"""Replay of trials from their rows: to record videos, and to check that they are reproduced."""

from dataclasses import dataclass, replace
from pathlib import Path

from dexgrasp.evaluation.protocol import TrialSeeds
from dexgrasp.evaluation.settings import EvaluationSettings, TrialSpec, plan_trials
from dexgrasp.evaluation.store import Key, Trials, read_rows, read_run, row_key, trial_name
from dexgrasp.evaluation.summary import grouped
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.evaluation.video import VideoSettings, require_rendering
from dexgrasp.runs.pool import Backend, run_pool
from dexgrasp.runs.progress import Show, warn
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand


@dataclass(frozen=True)
class Replay:
    """Replayed trial.

    Attributes:
        row: its line in trials.jsonl.
        again: its row now.
        grasp: planned now, for agents that certify theirs.
        changed: keys of the row that differ; none with the same code and files.
        stale: parts of the evaluation's identity that differ now: cell, code, files, versions.
        video: file, or None.
    """

    row: Fields
    again: Fields
    grasp: Fields | None
    changed: tuple[str, ...]
    stale: tuple[str, ...]
    video: Path | None


def replay(
    folder: Path,
    agent: str,
    target: str,
    trial: int,
    *,
    protocol: str | None = None,
    film: VideoSettings | None = None,
    robot: str | None = None,
) -> Replay:
    """Replay a trial of an evaluation, from the seeds in its row.

    Args:
        folder: of the evaluation.
        agent: its name there.
        target: the object's name there.
        trial: number.
        protocol: needed where the evaluation has several.
        film: settings of a video, written into `videos/` of the folder; None for no video.
        robot: path of the cell's file, where it is not where it was.

    Raises:
        InputError: if the folder holds no such trial, or its agent or object cannot be had any more.
    """
    row = _find(read_rows(folder), agent, target, trial, protocol)
    run = read_run(folder)
    settings = EvaluationSettings.of_run({**run, "robot": robot or _robot(run)})
    spec, path = _specs([row], settings)[row_key(row)], None
    if film:
        require_rendering()
        path = video_path(folder, row)
        spec = replace(spec, video=path, film=film)
    runner = TrialRunner(settings)
    again, grasp = runner.run(spec)
    runner.close()
    now = settings.identity()
    stale = tuple(key for key in ("cell", "code", "files", "versions") if run.get(key) != now[key])
    return Replay(row, again, grasp, changes(row, again), stale, path)


def _robot(run: Fields) -> str | None:
    """Return the cell that a run.json names; a path must still exist."""
    path: str | None = run.get("robot")
    if isinstance(path, str) and Path(path).suffix and not expand(path).is_file():
        raise InputError(f"the file of the cell is not at {path} any more: pass it with --robot")
    return path


def record(
    runner: TrialRunner, rows: Trials, folder: Path, film: VideoSettings, backend: Backend, show: Show
) -> None:
    """Replay trials and record those that have no video yet; `show` is called with the number done and in all."""
    left = {row_key(row): row for row in rows if not video_path(folder, row).is_file()}
    specs = [
        replace(spec, video=video_path(folder, left[key]), film=film)
        for key, spec in _specs(list(left.values()), runner.settings).items()
    ]
    for done, (again, _) in enumerate(run_pool(runner.run, specs, backend), start=1):
        row = left[row_key(again)]
        if changed := changes(row, again):
            warn(
                f"note: the video of {trial_name(row)} shows another outcome than trials.jsonl ({', '.join(changed)})"
            )
        show(done, len(specs))


def video_path(folder: Path, row: Fields) -> Path:
    """Return the path of the video of a trial."""
    return folder / "videos" / f"{trial_name(row)}.mp4"


def changes(row: Fields, again: Fields) -> tuple[str, ...]:
    """Return the keys of a row whose values differ, to the last bit."""
    compared = ("success", "stable", "reason", "stage", "steps", "height", "slip", "tilt")
    return tuple(key for key in compared if key in row and row[key] != again[key])


def _find(rows: Trials, agent: str, target: str, trial: int, protocol: str | None) -> Fields:
    found = rows
    for key, value in {"agent": agent, "object": target, "trial": trial}.items():
        valid = grouped(found, key)
        if value not in valid:
            raise InputError(f"no finished trial of {key} {value!r}: valid are {', '.join(map(str, valid))}")
        found = valid[value]
    names = [row["protocol"] for row in found]
    found = [row for row in found if protocol in (None, row["protocol"])]
    if len(found) != 1:
        raise InputError(f"which protocol of {', '.join(names)}? name it with --protocol")
    return found[0]


def _specs(rows: Trials, settings: EvaluationSettings) -> dict[Key, TrialSpec]:
    """Return the specification of each row's trial, with the seeds of the row."""
    planned = {spec.key: spec for spec in plan_trials(settings)}
    found = {}
    for row in rows:
        spec = planned.get(row_key(row))
        if spec is None:
            raise InputError(f"trial {trial_name(row)} is not of the evaluation that run.json describes")
        found[spec.key] = replace(spec, seeds=TrialSeeds(row["scene_seed"], row["agent_seed"]))
    return found
