"""Trials made again from what their lines say: to watch them, and to see that they come out the same."""

import dataclasses
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.protocol import TrialSeeds
from dexgrasp.evaluation.rows import trial_name
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.spec import TrialSpec, plan_trials
from dexgrasp.evaluation.store import read_rows, read_run
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.evaluation.video import Film, check_rendering
from dexgrasp.evaluation.workers import Backend, run_cells
from dexgrasp_env.errors import InputError

Row = Mapping[str, Any]
_COMPARED = ("success", "stable", "reason", "stage", "steps", "height", "slip", "tilt")


@dataclass(frozen=True)
class Replay:
    """A trial made again.

    Attributes:
        row: its line in trials.jsonl.
        again: the line that it would have now.
        grasp: as it was planned now, for agents that certify theirs.
        changed: what came out otherwise: nothing, with the same code and files.
        stale: what the evaluation was made with that is not so any more.
        video: file, or None.
    """

    row: Row
    again: Row
    grasp: Row | None
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
    video: bool = False,
    film: Film = Film(),
) -> Replay:
    """Make a trial of an evaluation again, from the seeds that its line holds.

    Args:
        folder: of the evaluation.
        agent: its name there.
        target: the object's name there.
        trial: number.
        protocol: needed where the evaluation has several.
        video: whether to record it, into `videos/` of the folder.
        film: what the video is taken with.

    Raises:
        InputError: if the folder holds no such trial, or its agent or object cannot be had any more.
    """
    row = _find(read_rows(folder), agent, target, trial, protocol)
    run = read_run(folder)
    settings = EvaluationSettings.of_run(run)
    spec = _spec_of(row, settings)
    if video:
        check_rendering()
        spec = dataclasses.replace(spec, video=str(video_path(folder, row)), film=film)
    runner = TrialRunner(settings)
    again, grasp = runner.run(spec)
    runner.close()
    now = settings.identity()
    stale = tuple(key for key in ("cell", "code", "files", "versions") if run.get(key) != now[key])
    return Replay(row, again, grasp, changes(row, again), stale, Path(spec.video) if spec.video else None)


def record(
    settings: EvaluationSettings,
    rows: Sequence[Row],
    folder: Path,
    film: Film,
    backend: Backend,
    runner: TrialRunner,
) -> Iterator[Row]:
    """Make trials again and record them; yield each line as its video is there. Videos that are there are kept."""
    left = [row for row in rows if not video_path(folder, row).is_file()]
    specs = {_name(row): (row, _spec_of(row, settings)) for row in left}
    recorded = [
        dataclasses.replace(spec, video=str(video_path(folder, row)), film=film)
        for row, spec in specs.values()
    ]
    for again, _ in run_cells(settings, recorded, backend, runner):
        row = specs[_name(again)][0]
        if changed := changes(row, again):
            print(
                f"note: the video of {_name(row)} shows another outcome than trials.jsonl ({', '.join(changed)})",
                file=sys.stderr,
            )
        yield again


def video_path(folder: Path, row: Row) -> Path:
    """Return where the video of a trial is, if there is one."""
    return folder / "videos" / f"{trial_name(row)}.mp4"


def changes(row: Row, again: Row) -> tuple[str, ...]:
    """Return what came out otherwise, to the last bit."""
    return tuple(key for key in _COMPARED if key in row and row[key] != again[key])


def _name(row: Row) -> str:
    return trial_name(row)


def _find(rows: Sequence[Row], agent: str, target: str, trial: int, protocol: str | None) -> Row:
    wanted = {"agent": agent, "object": target, "trial": trial}
    found = rows
    for key, value in wanted.items():
        valid = list(dict.fromkeys(row[key] for row in found))
        found = [row for row in found if row[key] == value]
        if not found:
            raise InputError(f"no finished trial of {key} {value!r}: valid are {', '.join(map(str, valid))}")
    names = [row.get("protocol") for row in found]
    found = [row for row in found if protocol in (None, row.get("protocol"))]
    if len(found) != 1:
        raise InputError(f"which protocol of {', '.join(map(str, names))}? name it with --protocol")
    return found[0]


def _spec_of(row: Row, settings: EvaluationSettings) -> TrialSpec:
    key = (row.get("protocol"), row["agent"], row["object"], row["trial"])
    for spec in plan_trials(settings):
        if (spec.protocol, spec.agent, spec.label, spec.trial) == key:
            if "agent_seed" not in row or "scene_seed" not in row:
                return spec
            return dataclasses.replace(spec, seeds=TrialSeeds(row["scene_seed"], row["agent_seed"]))
    raise InputError(f"trial {_name(row)} is not of the evaluation that run.json describes")
