"""Relaxation of requests that cannot be met: each constraint alone, nearest first, until there is a grasp."""

from dataclasses import replace

from dexgrasp.geometry.request import ANYHOW, Demand, GraspRequest, relaxations
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.grasp import Grasp
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.planning.diverse import UNSURE
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.result import SearchLog
from dexgrasp_env.arrays import Array


def nearest_relaxation(planner: Planner, target: GraspTarget, seed: int, start: Array, log: SearchLog) -> str:
    """Return in words which constraint of the planner's request rules a grasp out, and what can be had; "" without any.

    Args:
        planner: that found no grasp, or none that bears the weight.
        target: the object.
        seed: of everything that is drawn.
        start: (n,) rad, set-points the robot approaches from.
        log: of the search that found none.
    """

    def planned(asked: GraspRequest) -> Grasp | None:
        """Return the grasp that there is for another request, and that bears the weight."""
        demand = Demand(asked, planner.cell.T_base_world)
        grasp = planner.asking(asked).plan(replace(target, demand=demand), seed, start).grasp
        return grasp if grasp is not None and grasp.certificate.holds else None

    request, words = planner.request, list[str]()
    if UNSURE in log.blocked:
        sure = float(request.min_probability or 0.0)
        return f"none held with probability {sure}; one with {sure - log.blocked[UNSURE][1]:.2f}"
    if not request.constrains:  # what is known of the object cannot be left out
        return ""
    if planned(ANYHOW) is None:
        return "no grasp bears the weight without the request either"
    for name, steps in relaxations(request).items():
        for step in steps:
            found = planned(step)
            if found is not None:
                words.append(_in_words(name, request, step, found))
                break
    return "; ".join(words) or "there is one without the request, and none where one part of it is left out"


def _in_words(name: str, request: GraspRequest, step: GraspRequest, grasp: Grasp) -> str:
    """Return how far a grasp, found for a step of its relaxation, is from a constraint of a request."""
    if name == "approach":
        face = palm_frame(grasp.q, robot_tree(grasp.cell))[0][None, :, 0]
        off = Demand(request, grasp.cell.T_base_world).off(face)[0]
        return f"none whose palm faces {request.approach}; one at {off:.0f} degrees"
    if name == "fingers":
        return f"none with {' '.join(request.fingers)}; one with {' '.join(grasp.fingers)}"
    if name == "goal":
        return "none that can be set down there; one that lifts it"
    if name == "max_force":
        press = -(grasp.forces[:, :3] * grasp.normals).sum(1).min()
        return f"none with at most {request.max_force:g} N a finger; one with {press:.1f} N"
    if wider := getattr(step, name):  # what tips touch there may miss it, though contacts do not
        off = abs(wider[0].radius - getattr(request, name)[0].radius)
    else:
        off = max(0.0, Demand(request, grasp.cell.T_base_world).outside(grasp.contacts).max())
    where = "to be held" if name == "hold" else "not to be avoided"
    return f"none whose tips touch only what is {where}; one whose tips miss it by {1000.0 * off:.0f} mm"
