"""Grasp files under protocols: a row for each grasp and protocol, and a summary with intervals."""

import time
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

from dexgrasp.evaluation.scoring.hand import Candidate
from dexgrasp.evaluation.scoring.metrics import contact_metrics, diversity
from dexgrasp.evaluation.scoring.protocols import get_grasp_protocol
from dexgrasp.evaluation.scoring.readers import ReadOptions, read_candidates
from dexgrasp.evaluation.summary import bare_count, count, grouped
from dexgrasp.runs.pool import Backend, run_pool
from dexgrasp.runs.progress import progress_bar
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError

Scored = tuple[list[Fields], Fields]
"""What came of one grasp: a row for each protocol, and its metrics."""


def score_files(
    paths: Sequence[Path],
    protocols: Sequence[str],
    options: ReadOptions,
    *,
    seed: int = 0,
    workers: int = 1,
) -> Fields:
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
    candidates = [one for path in dict.fromkeys(paths) for one in read_candidates(path, options)]
    if not candidates:
        raise InputError("no grasps to score")
    scored = dict[int, Scored]()
    work = partial(score_grasp, protocols=names, seed=seed)
    with progress_bar("grasp", "score") as show:
        for number, result in run_pool(work, list(enumerate(candidates)), Backend(workers=workers)):
            scored[number] = result
            show(len(scored), len(candidates))
    by_protocol, metrics = zip(*(scored[k] for k in range(len(candidates))), strict=True)
    rows = [row for own in by_protocol for row in own]
    measured = [name for name, value in metrics[0].items() if isinstance(value, float)]
    return {
        "schema": 1,
        "seed": seed,
        "grasps": len(candidates),
        "protocols": {name: _summary(own) for name, own in grouped(rows, "protocol").items()},
        "metrics_mean": {name: float(np.mean([row[name] for row in metrics])) for name in measured},
        "diversity": diversity(candidates),
        "rows": rows,
        "metrics": list(metrics),
    }


def score_grasp(numbered: tuple[int, Candidate], protocols: Sequence[str], seed: int) -> tuple[int, Scored]:
    """Return the number of a grasp, and what came of it."""
    number, candidate = numbered
    about = {"grasp": candidate.source, "object": candidate.object.name}
    rows = []
    for name in protocols:
        start = time.perf_counter()
        # The same noise for every grasp, so that grasps are compared under the same draws.
        verdict = get_grasp_protocol(name).judge(candidate, seed + zlib.crc32(name.encode()))
        rows.append({**about, "protocol": name, **asdict(verdict), "seconds": time.perf_counter() - start})
    return number, (rows, {**about, **contact_metrics(candidate)})


def _summary(rows: Sequence[Fields]) -> Fields:
    """Return counts, rate, intervals, the mean score and the reasons of one protocol."""
    return {
        **count([{**row, "trial": number} for number, row in enumerate(rows)]),  # each grasp for itself
        "mean_score": float(np.mean([row["score"] for row in rows])),
        "by_object": {name: bare_count(own) for name, own in grouped(rows, "object").items()},
        "failures": dict(Counter(row["reason"] for row in rows if not row["success"]).most_common()),
    }
