"""Rows that a request adds to the optimisation: where contacts lie, how far other links keep off, where the palm faces.

They aim at more than is accepted: an object is seldom quite where it was seen, and turns by some degrees in the hand as
it is squeezed.
"""

from typing import NamedTuple

import numpy as np

from dexgrasp.mechanics.kinematics.clearance import KINDS, OBJECT
from dexgrasp.mechanics.kinematics.forward import body_frames, fingertips, tip_jacobian
from dexgrasp.mechanics.kinematics.palm_ik import TURN_SCALE, palm_jacobian
from dexgrasp.planning.constraints import ANGLE_SCALE, Evaluation
from dexgrasp.planning.settings import GraspProblem
from dexgrasp_env.arrays import Array

ASKED_KINDS = "contact_outside_request", "palm_direction"


class Reserve(NamedTuple):
    """Distances from the edge of what is asked for."""

    contact: float  # m, of contacts from the edge of where they may be
    link: float  # m, of links that are not to touch the object from it
    turn: float  # rad, of the palm from the edge of its cone


AIMED, LEAST = Reserve(0.006, 0.010, 0.02), Reserve(1e-4, 0.004, 2e-4)


def with_request(now: Evaluation, q: Array, problem: GraspProblem, reserve: Reserve) -> Evaluation:
    """Return the constraints at `q` (n,) rad, and those of the request: links that touch nothing are farther off."""
    demand, tree = problem.target.demand, problem.tree
    frames, values = body_frames(q, tree), now.values.copy()
    added, rows, labels = [values], [now.rows], [now.labels]
    if demand.request.hold or demand.request.avoid:
        # Links that come nearer than this touch an object that is not quite where it was seen, wherever that is.
        idle = (now.labels[:, 0] == OBJECT) & ~np.isin(now.labels[:, 1], tree.tip_body)
        values[idle] -= reserve.link - problem.settings.clearance
        outside, slope = demand.outside(now.contacts)
        slope -= (slope * now.normals).sum(1, keepdims=True) * now.normals
        added.append(-outside - reserve.contact)
        rows.append(-np.einsum("fr,frj->fj", slope, tip_jacobian(tree, frames, fingertips(q, tree))))
        labels.append(np.array([[len(KINDS), body, -1] for body in tree.tip_body]))
    if demand.request.approach:
        face = (frames.R[tree.palm] @ tree.palm_rotation)[:, 0]
        beyond, slope = demand.turned(face)
        turns, row = np.empty((6, tree.arm)), np.zeros((1, len(q)))
        palm_jacobian(tree, frames, turns)
        row[0, : tree.arm] = -ANGLE_SCALE / TURN_SCALE * np.cross(face, slope) @ turns[3:]
        added.append(np.array([-ANGLE_SCALE * (beyond + reserve.turn)]))
        rows.append(row)
        labels.append(np.array([[len(KINDS) + 1, tree.palm, -1]]))
    return now._replace(
        values=np.concatenate(added), rows=np.concatenate(rows), labels=np.concatenate(labels)
    )
