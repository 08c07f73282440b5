"""Does `load` predict? Push executed grasps until they fail, beside what their certificates claim.

    python scripts/load_predicts.py --objects all20 --seeds 40 41 --out runs/load

Agent `bilevel` plans from the cameras and lifts; then a force on the centre of mass grows evenly, by a fortieth of the
claim a control step (50 ms), in a random direction of the world, until the object has moved 2 cm in the hand or three
times the claim is reached. The state is taken back to where the grasp was held for each direction. The claim is
(load - 1) x assumed weight: the push that the certificate says is borne besides the weight, in any direction. One line
a grasp goes into DIR/pushes.jsonl, those that are there are not made again; DIR/summary.json has the figures.
"""

import argparse
import json
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.physics.contacts import GRAVITY
from dexgrasp.planning.look import Look, look_at
from dexgrasp.runs.lines import Lines
from dexgrasp_env.arrays import Array
from dexgrasp_env.files import write_json
from dexgrasp_env.objects.load import resolve_targets

_GROWTH = 1.0 / 40.0  # of the claim a control step
_MOST = 3.0  # claims
_LEAST_CLAIM = 0.5  # N: of smaller ones the growth would never end
_SLIP = 0.02  # m in the hand
_STEPS = 300  # control steps until it must be held
_BELOW = 0.8


def grasp_row(target: str, seed: int, count: int) -> dict[str, Any]:
    """Plan, lift and push one object in `count` directions; return a line of pushes.jsonl."""
    agent = BilevelAgent()
    look = look_at(target, agent, seed)
    agent.reset(look.observation, look.info)
    grasp = agent.result.grasp if agent.result else None
    row: dict[str, Any] = {"target": target, "seed": seed, "planned": grasp is not None, "pushes": []}
    if grasp is not None:
        certificate, env = grasp.certificate, look.env.unwrapped
        row |= {
            "load": certificate.load,
            "assumed_mass": certificate.mass,
            "mass": float(env.simulation.object.mass),
        }
        claim = max((certificate.load - 1.0) * certificate.mass * GRAVITY, _LEAST_CLAIM)
        observation, rng = _lifted(look, agent), np.random.default_rng([seed, len(target)])
        if observation is not None:
            row["pushes"] = pushes(env, agent, observation, claim, rng.standard_normal((count, 3)))
    look.env.close()
    return row


def _lifted(look: Look, agent: BilevelAgent) -> Any:
    """Carry the grasp out until the object is held; return the observation then, None if it never is."""
    observation = look.observation
    for _ in range(_STEPS):
        observation, _, over, _, info = look.env.unwrapped.step(agent.act(observation))
        if info["is_success"] or over:
            return observation if info["is_success"] else None
    return None


def pushes(
    env: Any, agent: BilevelAgent, observation: Any, claim: float, along: Array
) -> list[dict[str, Any]]:
    """Push the held object from the same state along each of (N, 3); return what it bore, N and in claims."""
    state, rows = env.get_state(), []
    for direction in along / np.linalg.norm(along, axis=1, keepdims=True):
        env.set_state(state)
        push = (
            _borne(env, deepcopy(agent), observation, claim * direction) * claim
        )  # the agent remembers what it felt
        rows.append({"direction": direction.tolist(), "claim": claim, "push": push, "ratio": push / claim})
    return rows


def _borne(env: Any, agent: BilevelAgent, observation: Any, claim: Array) -> float:
    """Return the largest multiple of a force (3,) N that the grasp bore; the most if it never failed."""
    data, body = env.data, env.simulation.body
    before, borne = _in_hand(data, body), 0.0
    for share in np.arange(_GROWTH, _MOST + _GROWTH / 2, _GROWTH):
        data.xfrc_applied[body, :3] = share * claim
        observation, _, over, _, _ = env.step(agent.act(observation))
        if over or np.linalg.norm(_in_hand(data, body) - before) > _SLIP:
            break
        borne = float(share)
    data.xfrc_applied[:] = 0.0
    return borne


def _in_hand(data: Any, body: int) -> Array:
    """Return where the object's middle is, as the palm sees it, m."""
    palm = data.site("palm")
    found: Array = palm.xmat.reshape(3, 3).T @ (data.xpos[body] - palm.xpos)
    return found


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return how often grasps failed below 0.8 of the claim, and what they bore in claims: 5 %, median, 95 %."""
    ratios = np.array([push["ratio"] for row in rows for push in row["pushes"]])
    below = int((ratios < _BELOW).sum())
    return {
        "schema": 1,
        "grasps": sum(row["planned"] for row in rows),
        "not_lifted": sum(row["planned"] and not row["pushes"] for row in rows),
        "pushes": len(ratios),
        "failed_below_0.8_of_claim": below,
        "ci95": wilson_interval(below, len(ratios)),
        "ratio_p5_median_p95": np.quantile(ratios, [0.05, 0.5, 0.95]).tolist() if len(ratios) else None,
    }


def main(argv: list[str] | None = None) -> None:
    """Make the grasps that are not in the file yet, and summarise."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--objects", nargs="+", default=["all20"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[40, 41])
    parser.add_argument("--pushes", type=int, default=6, help="directions a grasp")
    parser.add_argument("--out", type=Path, default=Path("runs/load"))
    args = parser.parse_args(argv)
    args.out.mkdir(parents=True, exist_ok=True)
    lines = Lines(args.out / "pushes.jsonl", "grasp that was pushed", lambda row: None)
    done = {(row["target"], row["seed"]) for row in lines.rows}
    jobs = [(target, seed) for seed in args.seeds for target in resolve_targets(args.objects)]
    for target, seed in tqdm([job for job in jobs if job not in done], unit="grasp"):
        lines.append(grasp_row(target, seed, args.pushes))
    found = summary(lines.rows)
    print(json.dumps(found, indent=1))
    write_json(args.out / "summary.json", found)


if __name__ == "__main__":
    main()
