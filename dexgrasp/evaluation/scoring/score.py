"""Scores of grasp files: a row for each grasp and protocol, and a summary with intervals.

The metrics of DexGraspBench (contacts of hand and object, penetration) are reported as well.
"""

import time
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.evaluation.scoring.hand import FloatingGrasp
from dexgrasp.evaluation.scoring.protocols import get_grasp_protocol
from dexgrasp.evaluation.scoring.readers import ReadOptions, read_candidates
from dexgrasp.evaluation.scoring.scene import ContactPhysics, FloatingScene
from dexgrasp.evaluation.summary import bare_count, count, grouped
from dexgrasp.grasp.diversity import component_shares
from dexgrasp.runs.pool import Backend, run_pool
from dexgrasp.runs.progress import progress_bar
from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError

Scored = tuple[list[Fields], Fields]
"""Rows of one grasp, one for each protocol, and its metrics."""


def score_files(
    paths: Sequence[Path],
    protocols: Sequence[str],
    options: ReadOptions,
    *,
    seed: int = 0,
    workers: int = 1,
) -> Fields:
    """Score every grasp of the files; the result does not depend on the number of workers.

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


def score_grasp(
    numbered: tuple[int, FloatingGrasp], protocols: Sequence[str], seed: int
) -> tuple[int, Scored]:
    """Return the number of a grasp, and its rows and metrics."""
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


def contact_metrics(candidate: FloatingGrasp) -> dict[str, float]:
    """Return metrics of the grasp stage, against the convex parts that the simulator collides.

    Returns:
        `penetration_m` and `self_penetration_m`, the deepest; `contact_number`, links of the hand within 2 mm;
        `contact_distance_m`, the mean over fingers of their distance (0 inside, at most 10 mm); and
        `contact_consistency_m`, the largest difference of the fingers' signed distances.
    """
    scene = FloatingScene(candidate, ContactPhysics(), 0.1)
    model, data = scene.model, scene.data
    of_object = model.geom_bodyid == scene.object_body
    margin = 0.010  # m: further apart than this is this far
    model.geom_margin[of_object] = model.geom_gap[of_object] = margin
    scene.reset(candidate.grasp)
    fingers = _fingers(scene)
    distances = dict.fromkeys(set(fingers.values()), margin)
    touching, deepest = set(), 0.0
    for body, distance, _ in scene.hand_contacts():
        deepest = max(deepest, -distance)
        if abs(distance) < 0.002:  # m: a link this near touches
            touching.add(body)
        if body in fingers:
            distances[fingers[body]] = min(distances[fingers[body]], distance)
    found = np.array(list(distances.values()) or [margin])
    own = np.isin(model.geom_bodyid[data.contact.geom], scene.hand_bodies).all(axis=1)
    return {
        "penetration_m": deepest,
        "self_penetration_m": float(np.max(-data.contact.dist[own], initial=0.0)),
        "contact_number": float(len(touching)),
        "contact_distance_m": float(np.maximum(found, 0.0).mean()),
        "contact_consistency_m": float(np.ptp(found)),
    }


def diversity(candidates: Sequence[FloatingGrasp]) -> list[float]:
    """Return the share of variance that the first 1 to 5 principal components explain; lower is more varied.

    Features: hand's position in the object frame, m, its rotation vector, rad, joints; as DexGraspBench, unscaled.
    Empty for fewer than three grasps, or hands of different joints.
    """
    if len(candidates) < 3 or len({c.hand.joint_names for c in candidates}) > 1:
        return []
    return component_shares(np.array([_features(c) for c in candidates]))


def _features(candidate: FloatingGrasp) -> Array:
    T = np.linalg.inv(candidate.T_world_object) @ candidate.grasp.T_world_hand
    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_rotvec(), candidate.grasp.joints])


def _fingers(scene: FloatingScene) -> dict[int, int]:
    """Return body -> first body of its finger; fingers branch off the first body that has several children."""
    parents = scene.model.body_parentid
    branches = np.bincount(parents[scene.hand_bodies])
    palm = next((body for body in scene.hand_bodies[:-1] if branches[body] > 1), -1)
    found: dict[int, int] = {}
    for body in scene.hand_bodies:  # parents come first
        if parents[body] == palm or parents[body] in found:
            found[body] = found.get(int(parents[body]), body)
    return found
