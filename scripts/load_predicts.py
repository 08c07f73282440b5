"""Is `load` true? Push executed grasps as hard as their certificates claim, in the claim's own terms.

    python scripts/load_predicts.py --objects all20 --seeds 40 41 42 --out runs/load

The claim: as it was lifted, commanded no more, with friction as in the forces' cones (0.6), the hand bears a force of
(load - 1) x assumed weight besides the weight, in any direction. Agent `bilevel` plans from the cameras and lifts,
without turns; then its set-points are frozen, and a force on the centre of mass grows evenly for each of the ramps and
stays for 0.5 s, in random directions of the world, at each of the shares of the claim. The state is taken back to where
the grasp was held for each. What moves 2 cm in the hand has failed. One line a grasp goes into DIR/pushes.jsonl, those
that are there are not made again; DIR/summary.json has the figures, with intervals that grow as grasps differ: the
pushes of one are not independent.
"""

import json
import sys
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.cli.command import Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.protocol import trial_seeds
from dexgrasp.evaluation.summary import pooled
from dexgrasp.planning.scene_setup import Look, look_at
from dexgrasp.runs.folder import RunFolder
from dexgrasp.runs.lines import Lines
from dexgrasp.runs.pool import Backend, run_pool
from dexgrasp_env.arrays import Array
from dexgrasp_env.files import write_json
from dexgrasp_env.objects.load import resolve_targets
from dexgrasp_env.scene.constants import GRAVITY
from dexgrasp_env.valid import Count, Natural

FRICTION = 0.6  # of the world, as in the cones of `friction_hold`
SHARES = (0.8, 1.0)  # of the claim
RAMPS = (2, 40)  # control steps until the force is whole: 0.1 s and 2 s
_HELD = 10  # control steps that it stays: 0.5 s
_SLIP = 0.02  # m in the hand
_STEPS = 300  # control steps until it must be lifted


def grasp_row(job: tuple[str, int], count: int) -> dict[str, Any]:
    """Plan, lift and push one object, at a seed, in `count` directions; return a line of pushes.jsonl."""
    target, seed = job
    agent = BilevelAgent(turns=False, regrasps=0)
    look = look_at(target, agent, seed, friction=FRICTION)
    agent.reset(look.observation, look.info)
    grasp = agent.result.grasp if agent.result else None
    row: dict[str, Any] = {"target": target, "seed": seed, "planned": grasp is not None, "pushes": []}
    if grasp is not None:
        certificate, env = grasp.certificate, look.env.unwrapped
        claim = max(certificate.load - 1.0, 0.0) * certificate.mass * GRAVITY
        row |= {"load": certificate.load, "assumed_mass": certificate.mass, "claim": claim}
        row["mass"] = float(env.simulation.object.mass)
        action = _lifted(look, agent)
        if action is not None:
            row["pushes"] = pushes(env, action, claim, directions(target, seed, count))
    look.env.close()
    return row


def directions(target: str, seed: int, count: int) -> Array:
    """Return random directions (count, 3), of any length; each follows from the object, the seed and its number."""
    rngs = [np.random.default_rng(trial_seeds(seed, target, number).agent) for number in range(count)]
    return np.stack([rng.standard_normal(3) for rng in rngs])


def _lifted(look: Look, agent: BilevelAgent) -> Array | None:
    """Carry the grasp out until the object is held; return the last action, None if it never is."""
    observation = look.observation
    for _ in range(_STEPS):
        action = agent.act(observation)
        observation, _, over, _, info = look.env.unwrapped.step(action)
        if info["is_success"] or over:
            return action if info["is_success"] else None
    return None


def pushes(env: Any, action: Array, claim: float, along: Array) -> list[dict[str, Any]]:
    """Push the held object from the same state along each of (N, 3), at each share of a claim, N, and ramp."""
    state, rows = env.get_state(), []
    for direction in along / np.linalg.norm(along, axis=1, keepdims=True):
        for share, ramp in product(SHARES, RAMPS):
            env.set_state(state)
            moved = _moved(env, action, share * claim * direction, ramp)
            pushed = {"share": share, "ramp": ramp, "moved": moved, "failed": moved > _SLIP}
            rows.append({"direction": direction.tolist(), **pushed})
    return rows


def _moved(env: Any, action: Array, force: Array, ramp: int) -> float:
    """Return how far the object moves in the hand, m, as a force (3,) N grows and stays; at most until it fails."""
    data, body = env.data, env.simulation.body
    before, farthest = _in_hand(data, body), 0.0
    for step in range(ramp + _HELD):
        data.xfrc_applied[body, :3] = min(1.0, (step + 1) / ramp) * force
        env.step(action)
        farthest = max(farthest, float(np.linalg.norm(_in_hand(data, body) - before)))
        if farthest > _SLIP:
            break
    data.xfrc_applied[:] = 0.0
    return farthest


def _in_hand(data: Any, body: int) -> Array:
    """Return where the object's middle is, as the palm sees it, m."""
    palm = data.site("palm")
    found: Array = palm.xmat.reshape(3, 3).T @ (data.xpos[body] - palm.xpos)
    return found


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return how many pushes failed, by share of the claim and ramp, and the loads that were claimed."""
    found: dict[str, Any] = {
        "schema": 3,
        "friction": FRICTION,
        "grasps": sum(row["planned"] for row in rows),
        "not_lifted": sum(row["planned"] and not row["pushes"] for row in rows),
        "load_p5_median_p95": np.quantile(
            [row["load"] for row in rows if row["planned"]], [0.05, 0.5, 0.95]
        ).tolist(),
    }
    for share, ramp in product(SHARES, (None, *RAMPS)):
        pushes = [
            {"object": row["target"], "trial": row["seed"], "success": push["failed"]}
            for row in rows
            for push in row["pushes"]
            if push["share"] == share and ramp in (None, push["ramp"])
        ]
        failed = pooled([(pushes, 1.0)])
        name = f"at_{share}" + ("" if ramp is None else f"_ramp_{ramp / 20}_s")
        found[name] = {"pushes": failed["trials"], "failed": failed["successes"], "ci95": failed["ci95"]}
    return found


class Load(Script):
    """Makes the grasps that are not in the file yet, and summarises.

    Attributes:
        pushes: directions a grasp; a folder whose grasps have others is refused.
    """

    objects: tuple[str, ...] = ("all20",)
    seeds: tuple[Natural, ...] = (40, 41)
    pushes: Count = 6
    backend: Backend = Backend()
    out: Folder = Path("runs/load")

    def run(self) -> int:
        with RunFolder(self.out, "run.json", "set of pushes").claim({"schema": 3, "pushes": self.pushes}):
            lines = Lines(self.out / "pushes.jsonl", "grasp that was pushed", lambda row: None)
            done = {(row["target"], row["seed"]) for row in lines.rows}
            targets = resolve_targets(self.objects)
            jobs = [(target, seed) for seed in self.seeds for target in targets if (target, seed) not in done]
            rows = run_pool(partial(grasp_row, count=self.pushes), jobs, self.backend)
            for row in tqdm(rows, total=len(jobs), unit="grasp"):
                lines.append(row)
        found = summary(lines.rows)
        print(json.dumps(found, indent=1))
        write_json(self.out / "summary.json", found)
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Load))
