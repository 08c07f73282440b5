"""Grasps of an object in mid-air whose shape is known: what the protocols of floating hands score."""

import time

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.geometry.convex_parts import parts_within
from dexgrasp.geometry.surface_samples import triangle_samples
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.planned_record import ObjectPose
from dexgrasp.planning.diverse import plan_many
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.result import PlanResult, Progress
from dexgrasp.planning.scene_setup import Subject
from dexgrasp_env.objects.load import load_target
from dexgrasp_env.poses import rigid


def plan_floating(
    planner: Planner,
    source: str,
    seed: int,
    *,
    scale: float,
    mass: float | None,
    progress: Progress | None,
) -> tuple[Subject, PlanResult]:
    """Plan grasps of an object that is turned at random, far above the table, without an approach.

    Args:
        planner: whose arm holds the hand; files of grasps say where the palm is. Its request's count is of grasps.
        source: a name of the catalogue or a mesh file.
        seed: of the turn and of the proposals.
        scale: factor from a mesh file's unit to metres.
        mass: kg; None takes 0.1.
        progress: called with steps done and steps in all, where there is a count.

    Raises:
        InputError: for an unknown object.
    """
    began, model = time.perf_counter(), load_target(source, scale, None)
    R = Rotation.random(rng=seed).as_matrix()
    centre = np.array([0.5, 0.0, 0.45])  # m, where an arm gets a hand to most sides of an object
    points = triangle_samples(model.mesh.triangles, 3000, seed).points @ R.T + centre  # show hollows
    parts, _ = parts_within(model.solid.corners @ R.T + centre, points, None)
    target = GraspTarget.of_corners(parts, mass or 0.1, centre)  # kg, as DexGraspBench weighs it
    one = planner.request.count is None
    found = planner.plan(target, seed) if one else plan_many(planner, target, seed, None, progress)
    found.planning_seconds = time.perf_counter() - began
    return Subject(ObjectIdentity.of(model, source, scale), ObjectPose(model.solid, rigid(R, centre))), found
