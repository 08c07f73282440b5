"""Grasp files under protocols: a row for each grasp and protocol, and a summary with intervals."""

import time
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.evaluation.statistics import object_interval, wilson_interval
from dexgrasp.runs.pool import Backend, run_pool
from dexgrasp.runs.progress import progress_bar
from dexgrasp.scoring.candidate import Candidate
from dexgrasp.scoring.metrics import contact_metrics, diversity
from dexgrasp.scoring.protocols import get_grasp_protocol
from dexgrasp.scoring.readers import ReadOptions, read_candidates
from dexgrasp_env.errors import InputError

SCHEMA = 1


@dataclass(frozen=True)
class ScoreTask:
    """One grasp to score.

    Attributes:
        path: the file.
        number: of the grasp in the file.
        protocols: names.
        options: how to read the file.
        seed: of the protocols' draws.
    """

    path: Path
    number: int
    protocols: tuple[str, ...]
    options: ReadOptions
    seed: int


def score_files(
    paths: Sequence[Path],
    protocols: Sequence[str],
    options: ReadOptions,
    *,
    seed: int = 0,
    workers: int = 1,
    progress: bool = True,
) -> dict[str, Any]:
    """Score every grasp of the files; what comes out does not depend on the number of workers.

    Args:
        paths: grasp files.
        protocols: names of `protocols.GRASP_PROTOCOLS`.
        options: how to read the files.
        seed: of the protocols' draws, the same for every grasp.
        workers: processes.
        progress: whether to say on standard error how far it is.

    Returns:
        `rows`, one for each grasp and protocol, `metrics`, one for each grasp, and `protocols`, their summaries.

    Raises:
        InputError: for an unknown protocol, or a file that is not usable, before anything is simulated.
    """
    names = tuple(dict.fromkeys(protocols))
    for name in names:
        get_grasp_protocol(name)
    found = {path: _read(path, options) for path in dict.fromkeys(paths)}
    tasks = [ScoreTask(p, i, names, options, seed) for p, own in found.items() for i in range(len(own))]
    if not tasks:
        raise InputError("no grasps to score")
    results = _results(tasks, workers, progress)
    rows = [row for result in results for row in result["rows"]]
    metrics = [result["metrics"] for result in results]
    return {
        "schema": SCHEMA,
        "seed": seed,
        "grasps": len(tasks),
        "protocols": {name: _summary([row for row in rows if row["protocol"] == name]) for name in names},
        "metrics_mean": _means(metrics),
        "diversity": diversity([candidate for own in found.values() for candidate in own]),
        "rows": rows,
        "metrics": metrics,
    }


@lru_cache(maxsize=32)
def _read(path: Path, options: ReadOptions) -> tuple[Candidate, ...]:
    return tuple(read_candidates(path, options))


def score_grasp(task: ScoreTask) -> dict[str, Any]:
    """Return the rows and the metrics of one grasp."""
    candidate = _read(task.path, task.options)[task.number]
    about = {"grasp": candidate.source, "object": candidate.object.name}
    rows = []
    for name in task.protocols:
        start = time.perf_counter()
        # The same noise for every grasp, so that grasps are compared under the same draws.
        verdict = get_grasp_protocol(name).judge(candidate, task.seed + zlib.crc32(name.encode()))
        rows.append(
            {
                **about, "protocol": name, "success": verdict.success, "score": verdict.score,
                "reason": verdict.reason, "sentence": verdict.sentence, "moved_m": verdict.moved,
                "turned_rad": verdict.turned, "seconds": time.perf_counter() - start,
            }
        )  # fmt: skip
    return {"rows": rows, "metrics": {**about, **contact_metrics(candidate)}}


def _results(tasks: Sequence[ScoreTask], workers: int, progress: bool) -> list[dict[str, Any]]:
    found: dict[int, dict[str, Any]] = {}
    with progress_bar("grasp", "score", shown=progress) as show:
        for k, result in run_pool(_numbered, list(enumerate(tasks)), Backend(workers=workers)):
            found[k] = result
            show(len(found), len(tasks))
    return [found[k] for k in range(len(tasks))]


def _numbered(task: tuple[int, ScoreTask]) -> tuple[int, dict[str, Any]]:
    return task[0], score_grasp(task[1])


def _summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return counts, rate, intervals, the mean score and the reasons of one protocol."""
    counts: dict[str, tuple[int, int]] = {}
    for row in rows:
        k, n = counts.get(row["object"], (0, 0))
        counts[row["object"]] = k + row["success"], n + 1
    k, n = sum(row["success"] for row in rows), len(rows)
    return {
        "trials": n,
        "successes": k,
        "rate": k / n,
        "ci95": list(wilson_interval(k, n)),
        "ci95_objects": list(object_interval(counts)),
        "mean_score": float(np.mean([row["score"] for row in rows])),
        "by_object": {name: {"trials": n, "successes": k} for name, (k, n) in counts.items()},
        "failures": dict(Counter(row["reason"] for row in rows if not row["success"]).most_common()),
    }


def _means(metrics: Sequence[dict[str, Any]]) -> dict[str, float]:
    keys = [key for key, value in metrics[0].items() if isinstance(value, float)]
    return {key: float(np.mean([row[key] for row in metrics])) for key in keys}
