"""Grasp files under protocols: a row for each grasp and protocol, and a summary with intervals."""

import time
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dexgrasp.evaluation.summary import bare_count, count, grouped
from dexgrasp.runs.pool import Backend, run_pool
from dexgrasp.runs.progress import progress_bar
from dexgrasp.scoring.candidate import Candidate
from dexgrasp.scoring.metrics import contact_metrics, diversity
from dexgrasp.scoring.protocols import get_grasp_protocol
from dexgrasp.scoring.readers import ReadOptions, read_candidates
from dexgrasp_env.errors import InputError

SCHEMA = 1


class ScoreTask(NamedTuple):
    """One grasp to score: the file and the grasp's number in it, protocols, and the seed of their draws."""

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
) -> dict[str, Any]:
    """Score every grasp of the files; what comes out does not depend on the number of workers.

    Args:
        paths: grasp files.
        protocols: names of `protocols.GRASP_PROTOCOLS`.
        options: how to read the files.
        seed: of the protocols' draws, the same for every grasp.
        workers: processes.

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
    results: list[dict[str, Any]] = [{}] * len(tasks)
    with progress_bar("grasp", "score") as show:
        for done, (k, result) in enumerate(
            run_pool(_numbered, list(enumerate(tasks)), Backend(workers=workers)), 1
        ):
            results[k] = result
            show(done, len(tasks))
    rows = [row for result in results for row in result["rows"]]
    metrics = [result["metrics"] for result in results]
    return {
        "schema": SCHEMA,
        "seed": seed,
        "grasps": len(tasks),
        "protocols": {name: _summary(own) for name, own in grouped(rows, "protocol").items()},
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
        rows.append({**about, "protocol": name, **asdict(verdict), "seconds": time.perf_counter() - start})
    return {"rows": rows, "metrics": {**about, **contact_metrics(candidate)}}


def _numbered(task: tuple[int, ScoreTask]) -> tuple[int, dict[str, Any]]:
    return task[0], score_grasp(task[1])


def _summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return counts, rate, intervals, the mean score and the reasons of one protocol."""
    return {
        **count(rows),
        "mean_score": float(np.mean([row["score"] for row in rows])),
        "by_object": {name: bare_count(own) for name, own in grouped(rows, "object").items()},
        "failures": dict(Counter(row["reason"] for row in rows if not row["success"]).most_common()),
    }


def _means(metrics: Sequence[dict[str, Any]]) -> dict[str, float]:
    keys = [key for key, value in metrics[0].items() if isinstance(value, float)]
    return {key: float(np.mean([row[key] for row in metrics])) for key in keys}
