"""Is there any grasp? Search reachable postures on an object's true surface for one that bears its true weight.

    python scripts/possible.py --objects all20 --friction 0.35 --out runs/possible
    python scripts/possible.py --objects all20 --mass-factor 1.5 --out runs/possible
    python scripts/possible.py --objects sets/ycb.json#048_hammer --out runs/possible

A posture counts when arm and hand reach it within the constraints of the planner (clearances, joint limits, tips on
the surface) with the object in one of its likely rest poses, anywhere in the usual region. It is judged with what is
true: surface, mass, centre of mass, the friction given, all 0.7 Nm of each joint, nothing kept in reserve. Contact
triples are drawn at random from all that can be in equilibrium, on the hull and, where that differs from the surface,
on each convex part; a contact must lie on the true surface and the hand clear of the other parts. In every other round
closure is not asked for, and triples may be such as need more friction. The first posture with a `load` of 1 or more
ends the search: the object is possible. Without one it goes on to `--postures`. What it says no to may still be
possible with the palm, with other fingers, or in a posture that nobody tried.

One line an object goes into DIR/possible.jsonl; those that are there are not done again.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from tqdm import tqdm

from dexgrasp.dataset.sampler import REACH
from dexgrasp.kinematics.clearance import clearance_rows, empty_rows
from dexgrasp.kinematics.forward import body_frames, fingertips
from dexgrasp.physics.closure import closure_sweep
from dexgrasp.planning.planner import Planner, warm_up
from dexgrasp.planning.problem import Problem
from dexgrasp.planning.proposals import LEAST_DISTANCE, Proposals, ProposalSource, graspable_points
from dexgrasp.planning.result import SearchLog
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array
from dexgrasp_env.files import content_hash
from dexgrasp_env.objects.load import load_target, object_name, resolve_targets
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.rest_poses import rest_poses
from dexgrasp_env.poses import pose_matrix

_LIKELY = 0.1  # probability of a rest pose that is looked at
_CONVEX = 0.97  # of the hull's volume that the surface encloses, from where the hull stands for it
_ON_SURFACE = 0.0015  # m
_ROUND, _EACH = 150, 60  # triples a round, and postures of them that are tried
_ROUNDS = 4000
_FREE = 0.7  # friction at which triples are drawn where closure is not asked for
_SMALL = 0.015  # m, sides of parts too small for a fingertip


class RandomTriples(ProposalSource):
    """Triples drawn evenly from all that can be in equilibrium at a friction, not ranked."""

    def __init__(self, friction: float) -> None:
        self._friction = friction

    def propose(self, target: GraspTarget, settings: PlannerSettings, rng: Generator) -> Proposals:
        """Return up to `settings.triples`."""
        points, normals = graspable_points(target, settings, rng)
        if len(points) < 3:
            return Proposals.none("no_surface_above_table")
        triples = closure_sweep(points, normals, self._friction, LEAST_DISTANCE)
        if not len(triples):
            return Proposals.none("no_closure_triple")
        some = triples[rng.choice(len(triples), min(len(triples), settings.triples), replace=False)]
        return Proposals(points[some], normals[some], np.full(len(some), np.nan))


class Scene:
    """An object at a place: its true surface, what is grasped of it, and the other parts."""

    def __init__(self, model: ObjectModel, mass: float, rng: Generator) -> None:
        poses = [pose for pose in rest_poses(model) if pose.probability >= _LIKELY] or rest_poses(model)[:1]
        pose = poses[rng.integers(len(poses))]
        yaw, place = rng.uniform(-np.pi, np.pi), [rng.uniform(*side) for side in REACH]
        T = pose_matrix(np.array([0.0, 0.0, pose.height]), np.array(pose.quat_wxyz))
        T = pose_matrix(np.array([*place, 0.0]), np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])) @ T
        self.surface = model.mesh.copy()
        self.surface.apply_transform(T)
        self._mass, self._centre, pieces = mass, T[:3, 3].copy(), _pieces(model)
        self.parts = [self._target(_moved(piece, T)) for piece in pieces]
        self.hull = self._target(self.surface)

    def _target(self, mesh: Any) -> GraspTarget:
        return GraspTarget.of(mesh, mass=self._mass, centre=self._centre)

    def wholes(self) -> Iterator[tuple[GraspTarget, list[GraspTarget]]]:
        """Yield what is grasped, the hull first, and what must be kept clear of then."""
        yield self.hull, []
        for k, part in enumerate(self.parts):
            if np.ptp(part.hull.vertices, axis=0).max() > _SMALL:
                yield part, self.parts[:k] + self.parts[k + 1 :]


def _pieces(model: ObjectModel) -> list[Any]:
    """Return the convex parts as meshes, object frame; none where the hull is the surface."""
    import trimesh

    if model.mesh.volume > _CONVEX * model.mesh.convex_hull.volume:
        return []
    found = []
    for part in model.parts:
        if len(part.vertices):
            hull = trimesh.convex.convex_hull(part.vertices)
            hull.apply_transform(pose_matrix(part.position, part.quat_wxyz))
            found.append(hull)
    return found


def _moved(mesh: Any, T: Array) -> Any:
    mesh = mesh.copy()
    mesh.apply_transform(T)
    return mesh


def _real(planner: Planner, q: Array, contacts: Array, scene: Scene, others: list[GraspTarget]) -> bool:
    """Whether contacts lie on the true surface, and hand and arm clear of the parts that are not grasped."""
    from trimesh.proximity import closest_point

    if closest_point(scene.surface, contacts)[1].max() > _ON_SURFACE:
        return False
    frames, rows, settings = body_frames(q, planner.tree), empty_rows(256, planner.tree), planner.settings
    tips, least = fingertips(q, planner.tree), settings.tip_radius + settings.distance[0]
    for other in others:
        if other.distance.distance(tips).min() < least:
            return False
        n = clearance_rows(planner.tree, frames, other.distance.obstacle, 0.01, True, rows)
        if n and rows.values[:n].min() < settings.clearance:
            return False
    return True


def settings_for(friction: float) -> PlannerSettings:
    """Return the planner's thresholds with nothing kept in reserve."""
    return replace(
        PlannerSettings(), friction=friction, friction_hold=friction, friction_squeeze=friction, place_error=0.0,
        torque_share=1.0, closure_margin=0.0, closure_aim=0.1, least_press=0.1, triples=_ROUND, postures=_EACH,
        neighbours=24,
    )  # fmt: skip


def search(model: ObjectModel, friction: float, factor: float, postures: int, seed: int) -> dict[str, Any]:
    """Search one object; return what was found, as a line of possible.jsonl."""
    settings, frictions = settings_for(friction), {True: friction, False: max(friction, _FREE)}
    planners = [Planner(settings, RandomTriples(mu), with_closure=closed) for closed, mu in frictions.items()]
    rng = np.random.default_rng([seed, int(content_hash(model.name), 16) % 2**32])
    best, tried, reached, rounds, began = 0.0, 0, 0, 0, time.process_time()
    with tqdm(
        total=postures, desc=f"{model.name} mu {friction} x {factor}", unit="posture", file=sys.stderr
    ) as bar:
        while reached < postures and best < 1.0 and rounds < _ROUNDS:
            planner = planners[rounds % 2]
            rounds += 1
            scene = Scene(model, factor * model.mass, rng)
            for target, others in scene.wholes():
                log = SearchLog()
                proposals = planner.source.propose(target, planner.settings, rng)
                starts = planner.starts(proposals, Problem(target, planner.tree, planner.settings))
                for _, at, hold in planner.candidates(starts, log):
                    if scene.parts and not _real(planner, at.q, at.evaluation.contacts, scene, others):
                        continue
                    reached += 1
                    bar.update()
                    best = max(best, hold.merit if hold.holds else hold.share)
                    if best >= 1.0:
                        break
                tried += log.tried
                if best >= 1.0 or reached >= postures:
                    break
    return {
        "object": model.name, "mass": factor * model.mass, "friction": friction, "mass_factor": factor, "seed": seed,
        "possible": best >= 1.0, "best_load": best, "reached": reached, "tried": tried,
        "cpu_seconds": round(time.process_time() - began, 1),
    }  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Search every object that is not in the file yet."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--objects", nargs="+", default=["all20"], help="names, sets, meshes, set files")
    parser.add_argument("--friction", type=float, default=0.7, help="of the contacts (default 0.7)")
    parser.add_argument("--mass-factor", type=float, default=1.0, help="times the true mass")
    parser.add_argument("--postures", type=int, default=2000, help="reachable ones, before the answer is no")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/possible"))
    args = parser.parse_args(argv)
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "possible.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {(r["object"], r["friction"], r["mass_factor"], r["seed"]) for r in lines}
    warm_up()
    for target in resolve_targets(args.objects):
        if (object_name(target), args.friction, args.mass_factor, args.seed) in done:
            continue
        row = search(
            load_target(target, 1.0, None), args.friction, args.mass_factor, args.postures, args.seed
        )
        with path.open("a") as file:
            file.write(json.dumps(row) + "\n")
        print(json.dumps(row), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
