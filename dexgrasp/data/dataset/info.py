"""Summary of a dataset: counts, histograms, coverage; and a random sample checked by `verify`."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.data.dataset.dataset import PoseGrasps, read_dataset, read_manifest
from dexgrasp.data.dataset.rest_scene import target_at
from dexgrasp.evaluation.statistics import quantiles
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.thresholds import Thresholds
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import about_z, quat_to_matrix
from dexgrasp_env.robot.cell import Cell, make_cell
from dexgrasp_env.valid import read


def summary(folder: Path) -> Fields:
    """Return counts and histograms of a dataset, as JSON holds them."""
    manifest, poses = read_manifest(folder), read_dataset(folder)
    totals, blocked = Counter[str](), Counter[str]()
    for pose in poses:
        totals.update(pose.counts)
        blocked.update(pose.blocked)
    decided, feasible = np.sum([p.scene["triples"] for p in poses], axis=0).tolist()
    margin, edges = _joined(poses, "margin"), [0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 1.01]
    bins = [f"{low:.2f} .. {high:.2f}" for low, high in pairwise(edges)]
    R = quat_to_matrix(_joined(poses, "palm_quat_wxyz").astype(float))
    approach = np.degrees(np.arccos(np.clip(-R[:, 2, 0], -1.0, 1.0)))  # of the palm, from straight down
    return {
        "schema": 1, "cell": manifest["cell"],
        "grasps": len(margin), "objects": len(manifest["objects"]), "rest_poses": len(poses),
        "triples_decided": decided, "triples_feasible": feasible,
        "counts": dict(totals), "blocked": dict(blocked.most_common()),
        "coverage": float(np.mean([p.coverage for p in poses])),
        "margin_histogram": dict(zip(bins, np.histogram(margin, edges)[0].tolist(), strict=True)),
        "approach_degrees": _levels(approach), "margin": _levels(margin),
        "poses": [
            {"object": p.name, "pose": p.pose, "probability": float(p.scene["probability"]), "grasps": len(p),
             "triples_feasible": int(p.scene["triples"][1]), "coverage": p.coverage}
            for p in poses
        ],
    }  # fmt: skip


def _joined(poses: Sequence[PoseGrasps], name: str) -> np.ndarray:
    return np.concatenate([pose.grasps[name] for pose in poses])


def _levels(values: np.ndarray) -> dict[str, float]:
    return quantiles(values.tolist(), p10=0.1, median=0.5, p90=0.9)


def check_sample(folder: Path, count: int, robot: str | None = None) -> Fields:
    """Check a random sample of grasps by `verify`.

    Grasps of a dataset have no motion, so approach and lift are not checked; nor are forces where `load` is -1.

    Args:
        folder: of the dataset.
        count: of grasps.
        robot: path of the cell's file, where it has moved.

    Returns:
        `checked`, `passed`, and how often each check failed.

    Raises:
        InputError: for a dataset of another cell.
    """
    from dexgrasp.grasp.verify.verify import verify

    poses, manifest, failures = read_dataset(folder), read_manifest(folder), Counter[str]()
    settings = manifest["settings"]
    thresholds = read(Thresholds, settings.get("planner"), "planner", more=True)
    cell = make_cell(robot or settings.get("robot"))
    if (made := manifest["cell"]) != cell.version:
        raise InputError(f"{folder} is of cell {made!r}: this is {cell.version!r}, give its own with --robot")
    grasps = [(pose, k) for pose in poses for k in range(len(pose))]
    chosen = np.random.default_rng(0).permutation(len(grasps))[:count]
    passed = 0
    for pose, k in (grasps[i] for i in chosen):
        parts = ["thresholds", "contacts", "limits", "clearance", "closure"]
        parts += ["forces"] if pose.grasps["load"][k] >= 0 else []
        record = _record(pose, k, thresholds, cell)
        failed = [check.name for check in verify(record, parts) if not check.holds]
        passed += not failed
        failures.update(failed)
    return {"checked": len(chosen), "passed": passed, "failures": dict(failures)}


def _record(pose: PoseGrasps, k: int, thresholds: Thresholds, cell: Cell) -> Any:
    import trimesh

    from dexgrasp.grasp.certificate import Certificate
    from dexgrasp.grasp.grasp import Grasp, GraspMotion
    from dexgrasp.grasp.planned_record import planned_record
    from dexgrasp_env.scene.constants import GRAVITY

    g = {name: values[k].astype(float) for name, values in pose.grasps.items()}
    seen = trimesh.convex.convex_hull(pose.scene["hull"])
    target = target_at(
        GraspTarget.of(seen, mass=float(pose.scene["mass"]), centre=pose.scene["centre"]), g["placement"]
    )
    R, shift = about_z(float(g["placement"][2])), np.array([*g["placement"][:2], 0.0])
    forces = g["forces"] @ R.T
    # Most claims are not made here.
    claims = replace(
        Certificate.unclaimed(len(forces)),
        distances_cm=tuple(100.0 * g["distances"]),
        closure_margin=float(g["margin"]),
        mass=float(forces[:, 2].sum()) / GRAVITY if g["load"] >= 0 else target.mass,
    )
    grasp = Grasp(
        g["q"], g["contacts"] @ R.T + shift, g["normals"] @ R.T, forces, claims,
        GraspMotion(g["q"], g["q"], g["q"]), cell,
    )  # fmt: skip
    return planned_record(pose.name, grasp, target, thresholds)
