"""Random grasp requests: the share of feasible ones that are answered, and whether contacts are where they were asked.

    python scripts/grasp_requests.py OUT [--seed 0] [--count 200]

Each is of an object of all20 in a drawn pose, seen by the cameras: a half-space through the object that 20 to 60 % of
its surface lies in, to hold or to avoid, or a cone of five. `bilevel` carries out what it finds; an answer is a grasp
that bears the assumed weight, as for the exit code of `dexgrasp plan`. What is not answered is searched for at length
(four seeds, three times the surface points, nine times the triples): what then has an answer could be met. Rows go to
OUT/rows.jsonl; the table is printed with Wilson intervals.
"""

import sys
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
from clouds import written
from numpy.random import Generator

from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.cli.command import Answer, Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.protocol import TrialSeeds
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.geometry.request import GraspRequest, Region
from dexgrasp.geometry.surface_samples import triangle_samples
from dexgrasp.grasp.file import record_of
from dexgrasp.grasp.verify.verify import verify
from dexgrasp.planning.scene_setup import Look, look_at
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.objects.catalogue import OBJECT_SETS
from dexgrasp_env.poses import placed, pose_matrix
from dexgrasp_env.valid import Count, Natural

CONES = ("top,30", "side,40", "front,45", "0,1,-1,40", "0,-1,-1,40")
SEARCHES = 4  # seeds
FAR = 1.0  # m


def drawn(k: int, surface: Array, rng: Generator) -> tuple[str, GraspRequest]:
    """Return the kind of request number `k`, and one for an object with a surface (N, 3) m."""
    kind = ("hold", "avoid", "approach")[k // 20 % 3]
    if kind == "approach":
        return kind, GraspRequest(approach=CONES[(k + k // 60) % len(CONES)])
    axis, share = int(rng.integers(3)), rng.uniform(0.2, 0.6)
    low, high = np.full(3, -FAR), np.full(3, FAR)
    if rng.random() < 0.5:
        low[axis] = np.quantile(surface[:, axis], 1.0 - share)
    else:
        high[axis] = np.quantile(surface[:, axis], share)
    region = (Region(low, high),)
    return kind, GraspRequest(**{kind: region})


def tip_contacts(lift: Any, start: Array) -> Array:
    """Return where bodies of the robot touch the object (N, 3) m, moved with it to where it was at the start."""
    model, contacts, held = lift.model, lift.data.contact, lift.data.body("object")
    robot = [model.body(name).id for name in lift.settings.cell.robot.bodies]
    bodies = model.geom_bodyid[contacts.geom]
    touching = (bodies == held.id).any(1) & np.isin(bodies, robot).any(1)
    now = pose_matrix(held.xpos, held.xquat)
    return placed(start @ np.linalg.inv(now), contacts.pos[touching])


def is_possible(look: Look, request: GraspRequest) -> bool:
    """Search at length for a grasp that meets a request and bears the weight."""
    settings = PlannerSettings(patience=8).broadened(3)
    for own in range(SEARCHES):
        other = BilevelAgent("surface", settings, request=request, regrasps=0)
        other.seed(own)
        grasp = other.plan(look.observation, look.info).grasp
        if grasp is not None and grasp.certificate.holds:
            return True
    return False


def trial(k: int, seed: int) -> Fields:
    """Return what became of request number `k`."""
    rng = np.random.default_rng([seed, k])
    target = OBJECT_SETS["all20"][k % 20]
    scene = int(rng.integers(2**31))
    look = look_at(target, BilevelAgent(), scene)
    pose, solid = look.subject.pose.T_world_object, look.subject.pose.surface
    surface = placed(pose, triangle_samples(solid.vertices[solid.faces], 400, rng).points)
    kind, request = drawn(k, surface, rng)
    agent = BilevelAgent(request=request, regrasps=0)  # a second look finds the object elsewhere
    outcome, grasp = run_trial(look.env, agent, TrialSeeds(scene, scene))
    row = {
        "k": k, "object": target, "kind": kind, "answered": grasp is not None and grasp["certificate"]["holds"],
        "reason": outcome.reason, "lifted": outcome.success,
    }  # fmt: skip
    if not row["answered"]:
        return row | {"possible": is_possible(look, request)}
    checks = [check.name for check in verify(record_of(grasp)) if not check.holds]
    lift: Any = look.env.unwrapped
    mujoco.mj_forward(lift.model, lift.data)
    touching = tip_contacts(lift, pose)
    outside = request.outside(touching).max(initial=-FAR) if kind != "approach" else -FAR
    return row | {"possible": True, "refused": checks, "outside_mm": 1000.0 * float(outside)}


def summary(rows: list[Fields]) -> Iterator[str]:
    """Yield the lines of the table."""
    for kind in ("hold", "avoid", "approach", None):
        own = [row for row in rows if kind in (None, row["kind"])]
        possible = [row for row in own if row["possible"]]
        answered = [row for row in own if row["answered"]]
        shares = (
            ("answered", answered, possible),
            ("lifted", [row for row in answered if row["lifted"]], answered),
            ("verified", [row for row in answered if not row["refused"]], answered),
            ("within 5 mm", [row for row in answered if row["outside_mm"] <= 5.0], answered),
        )
        for name, good, of in shares:
            if of:
                low, high = wilson_interval(len(good), len(of))
                yield f"{kind or 'all':9} {name:12} {len(good)} of {len(of)}  [{low:.2f}, {high:.2f}]"


class Requests(Script):
    """Draw requests, plan and execute grasps, and judge them.

    Attributes:
        out: folder for rows.jsonl.
        seed: of everything that is drawn.
        count: of requests.
    """

    out: Argument[Folder]
    seed: Natural = 0
    count: Count = 200

    def run(self) -> Answer:
        """Return the table."""
        rows = written(self.out, (trial(k, self.seed) for k in range(self.count)), self.count)
        return Answer({"rows": rows}, list(summary(rows)))


if __name__ == "__main__":
    sys.exit(run_script(Requests))
