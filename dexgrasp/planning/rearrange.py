"""Choose and plan the removal of a neighbour that blocks an object: which, by which grasp, and where to."""

from dataclasses import replace
from itertools import product

import numpy as np

from dexgrasp.geometry.neighbours import neighbours_of
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.grasp import RAISED
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.motion.collision import carried_into, raised_into
from dexgrasp.planning.certificate_builder import overlap
from dexgrasp.planning.plan_scene import plan_scene
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.result import PlanResult
from dexgrasp.planning.set_down import RISES, set_down
from dexgrasp.planning.settings import GraspProblem
from dexgrasp_env.arrays import Array
from dexgrasp_env.perception.scene import ObjectCloud, Scene

_GRID = 0.04  # m between places that are looked at


def plan_rearrangement(
    planner: Planner, scene: Scene, target: GraspTarget, seed: int, start: Array
) -> PlanResult | None:
    """Plan the removal of a neighbour that is in the way: a grasp of it, whose script sets it down elsewhere.

    There is None where none can be grasped and put somewhere.

    Args:
        planner: that found no grasp of the object.
        scene: what is seen.
        target: the object.
        seed: of everything that is drawn.
        start: (n,) rad, set-points the robot approaches from.
    """
    settings = replace(planner.settings, patience=0)
    quick = Planner(settings, planner.source, planner.cell)
    for k in _most_in_the_way(quick, scene, target, seed, start)[:8]:
        others = (*scene.neighbours[:k], *scene.neighbours[k + 1 :], scene.target)
        plan = plan_scene(quick, replace(scene, target=scene.neighbours[k], neighbours=others), seed, start)
        for one in plan.found:
            assert plan.target is not None and one.script is not None  # as there is a start
            problem = GraspProblem(plan.target, planner.cell, settings)
            for place, rise in product(_free_places(plan.target, target.centre), RISES):
                centre = plan.target.centre
                way = set_down(one.script, problem, place - centre[:2], rise, about=centre)
                if way is not None:
                    plan.found = [one._replace(script=way)]
                    return plan
    return None


def _most_in_the_way(
    planner: Planner, scene: Scene, target: GraspTarget, seed: int, start: Array
) -> list[int]:
    """Return the neighbours by how deep they are in the hand of the grasp without neighbours, or in what is lifted.

    Of those that are not in its way the near and high ones come first.
    """
    alone = planner.plan(replace(target, neighbours=()), seed, start)
    ranks = []
    for k, one in enumerate(scene.neighbours):
        beside = replace(
            target, neighbours=neighbours_of(replace(scene, neighbours=(one,), rest=ObjectCloud()))
        )
        deep = max(
            (_depth(found.script, beside, planner) for found in alone.found if found.script), default=0.0
        )
        off = np.linalg.norm(one.points[:, :2] - target.centre[:2], axis=1).min() - one.points[:, 2].max()
        ranks.append((-max(deep, raised_into(beside, RAISED)), off, k))
    return [k for _, _, k in sorted(ranks)]


def _depth(script: ActionScript, target: GraspTarget, planner: Planner) -> float:
    """Return how deep, m, a neighbour is in the hand that closes, or in the object that is lifted."""
    problem = GraspProblem(target, planner.cell, planner.settings)
    hand = [overlap(script.phases[phase][-1], problem) for phase in ("approach", "close", "squeeze")]
    return max(*hand, carried_into(target, script.way("lift"), problem.tree))


def _free_places(target: GraspTarget, kept: Array) -> Array:
    """Return places (N, 2) m on the table where an object and the hand around it have room, the nearest first."""
    # x and y, m, where things are set down.
    axes = [np.arange(low, high, _GRID) for low, high in ((0.34, 0.70), (-0.36, 0.36))]
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    corners = target.corners[:, :2]
    radius = np.linalg.norm(corners - target.centre[:2], axis=1).max()
    free = np.linalg.norm(places - kept[:2], axis=1) > radius + 0.16  # m from the object
    if target.around is not None:
        for height in (0.03, 0.10, 0.17):  # m above the table, at which a place must be free
            # 6 cm around it are for the hand.
            free &= target.around.distance(np.insert(places, 2, height, axis=1)) > radius + 0.06
    places = places[free]
    return places[np.argsort(np.linalg.norm(places - target.centre[:2], axis=1))[:8]]  # nearest
