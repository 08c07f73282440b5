"""Rows that a request adds to the optimisation: what tips touch, distance of other links, direction of the palm."""

import numpy as np

from dexgrasp.grasp.thresholds import PRESSED
from dexgrasp.mechanics.kinematics.clearance import KINDS, OBJECT, empty_rows, surface_rows
from dexgrasp.mechanics.kinematics.forward import body_frames
from dexgrasp.mechanics.kinematics.palm_ik import TURN_SCALE, palm_jacobian
from dexgrasp.planning.constraints import ANGLE_SCALE, Evaluation
from dexgrasp.planning.settings import GraspProblem
from dexgrasp_env.arrays import Array

ASKED_KINDS = "contact_outside_request", "palm_direction"

APART = (-PRESSED, 0.012)
"""m from surface that is not to be touched: tips, and other shapes, as what is squeezed turns."""
_TURN = 2e-4  # rad, of the palm from the edge of its cone


def with_request(now: Evaluation, q: Array, problem: GraspProblem) -> Evaluation:
    """Return the constraints at `q` (n,) rad, and those of the request: links that touch nothing are farther off."""
    demand, tree, barred = problem.target.demand, problem.tree, problem.target.barred
    frames, found = body_frames(q, tree), [(now.values, now.rows, now.labels)]
    if barred.n:
        near = np.union1d(tree.tip_body, now.labels[now.labels[:, 0] == OBJECT, 1])
        room = empty_rows(len(near), tree)
        n = surface_rows(problem.target.barred_groups, near, APART, tree, frames, problem.world, room)
        found.append((room.values[:n], room.gradients[:n], room.labels[:n]))
    if demand.request.approach:
        face = (frames.R[tree.palm] @ tree.palm_rotation)[:, 0]
        beyond, slope = demand.turned(face)
        turns, row = np.empty((6, tree.arm)), np.zeros((1, len(q)))
        palm_jacobian(tree, frames, turns)
        row[0, : tree.arm] = -ANGLE_SCALE / TURN_SCALE * np.cross(face, slope) @ turns[3:]
        value = -ANGLE_SCALE * (beyond + _TURN)
        found.append((np.array([value]), row, np.array([[len(KINDS) + 1, tree.palm, -1]])))
    values, rows, labels = map(np.concatenate, zip(*found, strict=True))
    return now._replace(values=values, rows=rows, labels=labels)
