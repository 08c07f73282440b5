"""KL weight and latent size of the CVAE: every pair trained alike, and judged on objects that no training saw.

    dexgrasp dataset generate --objects varied-0..89 --grasps-per-pose 30 --out runs/varied
    dexgrasp dataset generate --objects varied-90..101 --grasps-per-pose 30 --out runs/unseen
    python scripts/sweep_cvae.py runs/varied runs/unseen --out runs/sweep --json docs/cvae_sweep.json

The pair is chosen that has the largest share of feasible samples: latents drawn from the prior, decoded and put on the
hull, that the atlas can place and the bilevel optimisation can finish. What is there is not made again;
the table holds all that is in DIR.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import torch
import trimesh
from scipy.spatial.distance import pdist
from tqdm import tqdm

from dexgrasp.cvae.batches import split, test_batches
from dexgrasp.cvae.cvae_training import WEIGHTS, CvaeTraining, evaluate
from dexgrasp.cvae.settings import TrainingSettings
from dexgrasp.cvae.weights import read_weights
from dexgrasp.dataset.dataset import PoseGrasps, read_dataset
from dexgrasp.physics.margin import margins
from dexgrasp.planning.cvae_source import CvaeProposals
from dexgrasp.planning.decoder import NetworkSettings
from dexgrasp.planning.postures import atlas_postures
from dexgrasp.planning.problem import Problem
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.planning.sqp import solve
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.files import write_json
from dexgrasp_env.robot.cell import default_cell

SAMPLES = 100  # of the prior, a rest pose
PLACE = np.array([0.5, 0.0, 0.0])  # m, where objects lie before the robot
COLUMNS = {
    "fingertip_cm": "fingertips, cm", "kl": "KL, nats", "closure": "in closure", "feasible": "feasible",
    "spread_cm": "spread, cm",
}  # fmt: skip


def settings_of(kl_weight: float, latent: int, epochs: int) -> TrainingSettings:
    """Return the settings of a training: a quarter of the grasps and half of the points of a usual step."""
    network = NetworkSettings(latent=latent, points=256)
    return TrainingSettings(epochs, grasps=32, kl_weight=kl_weight, held_out_poses=False, network=network)


def judged(weights: Path, unseen: Sequence[PoseGrasps]) -> dict[str, float]:
    """Return how grasps of unseen rest poses are reconstructed, and what the prior's samples there are worth."""
    model, _ = read_weights(weights)
    parts = split(list(unseen), None, held_out_poses=False)
    batches = test_batches(parts["train"], 0, model.settings.points, model.settings.latent)
    rebuilt = evaluate(model, batches, 0.0, torch.device("cpu"))
    samples = [of_prior(CvaeProposals(weights, SAMPLES, ranked=False), pose) for pose in unseen]
    found = {name: [v for row in samples if (v := row[name]) is not None] for name in samples[0]}
    means = {name: float(np.mean(values)) if values else 0.0 for name, values in found.items()}
    return {"fingertip_cm": rebuilt["fingertip_cm"], "kl": rebuilt["kl"]} | means


def of_prior(source: CvaeProposals, pose: PoseGrasps) -> dict[str, float | None]:
    """Return the shares of samples in closure and feasible, and how far apart the feasible are, if there are two."""
    settings = replace(PlannerSettings(), triples=SAMPLES, postures=SAMPLES)
    hull = trimesh.convex.convex_hull(pose.scene["hull"] + PLACE)
    target = GraspTarget.of(hull, mass=float(pose.scene["mass"]), centre=pose.scene["centre"] + PLACE)
    found = source.propose(target, settings, np.random.default_rng([pose.pose, *pose.name.encode()]))
    closed, solutions = 0, []
    if len(found.contacts):
        closed = int((margins(found.contacts, found.normals, settings.friction)[0] > 0.0).sum())
        problem = Problem(target, default_cell(), settings)
        solutions = [solve(p.q, problem) for p in atlas_postures(found, problem)]
    good = [solution for solution in solutions if solution.feasible]
    centres = [solution.evaluation.contacts.mean(0) for solution in good]
    return {
        "closure": closed / SAMPLES, "feasible": len(good) / SAMPLES,
        "spread_cm": 100.0 * float(pdist(centres).mean()) if len(good) > 1 else None,
    }  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Train what is not trained, judge what is not judged, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path, help="dataset to train on")
    parser.add_argument("unseen", type=Path, help="dataset of other objects, to judge on")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="trainings, a folder each")
    parser.add_argument("--kl-weights", type=float, nargs="+", default=[0.02, 0.05, 0.1])
    parser.add_argument("--latents", type=int, nargs="+", default=[3, 6, 10])
    parser.add_argument("--epochs", type=int, default=20, help="of 50 steps each")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args(arguments)
    unseen = read_dataset(args.unseen)
    for weight, latent in tqdm(list(product(args.kl_weights, args.latents)), unit="training"):
        folder = args.out / f"kl-{weight}-latent-{latent}"
        CvaeTraining(args.data, folder, settings_of(weight, latent, args.epochs)).run()
        if not (folder / "judged.json").exists():
            pair = {"kl_weight": weight, "latent": latent}
            write_json(folder / "judged.json", pair | judged(folder / WEIGHTS, unseen))
    rows = [json.loads(path.read_text()) for path in sorted(args.out.glob("*/judged.json"))]
    best = max(rows, key=lambda row: row["feasible"])
    print("| KL weight | latent |", " | ".join(COLUMNS.values()), "|\n|" + "---:|" * (2 + len(COLUMNS)))
    for row in sorted(rows, key=lambda row: (row["kl_weight"], row["latent"])):
        print("|", " | ".join(f"{row[name]:.3g}" for name in ("kl_weight", "latent", *COLUMNS)), "|")
    if args.json:
        write_json(
            args.json, {"schema": 1, "epochs": args.epochs, "samples": SAMPLES, "chosen": best, "rows": rows}
        )


if __name__ == "__main__":
    main()
