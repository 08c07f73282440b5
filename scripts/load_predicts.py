"""Does `load` predict? Push executed grasps until they fail, beside what their certificates claim.

    python scripts/load_predicts.py --out runs/load
    python scripts/load_predicts.py --figure docs/images/load_predicts.png --json docs/load_predicts.json

Agent `bilevel` plans from the cameras and lifts; then a force on the centre of mass grows evenly, by a fortieth of the
claim a control step (50 ms), in a random direction of the world, until the object has moved 2 cm in the hand or three
times the claim is reached. The state is taken back to where the grasp was held for each direction. A grasp that does
not lift its object survives no push. One line a grasp goes into DIR/pushes.jsonl; those that are there are not made
again.

The claim is (load - 1) x assumed weight, the push that the certificate says is borne besides the weight, in any
direction; `ratio_of_whole` compares with load x assumed weight instead, as if all of it were free for the push.
"""

import argparse
import json
import sys
from copy import deepcopy
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.grasp.certificate import Certificate
from dexgrasp.physics.contacts import GRAVITY
from dexgrasp.planning.look import Look, look_at
from dexgrasp_env.arrays import Array
from dexgrasp_env.files import write_json
from dexgrasp_env.objects.load import resolve_targets

_GROWTH = 1.0 / 40.0  # of the claim a control step
_MOST = 3.0  # claims
_LEAST_CLAIM = 0.5  # N: of smaller ones the growth would never end
_SLIP = 0.02  # m in the hand
_STEPS = 300  # control steps until it must be held
_BELOW = 0.8
_EDGES = (0.0, 2.0, 4.0, 6.0, 8.0, 12.0, np.inf)  # N


def grasp_row(target: str, seed: int, pushes: int) -> dict[str, Any]:
    """Plan, lift and push one object; return a line of pushes.jsonl."""
    agent = BilevelAgent()
    look = look_at(target, agent, seed)
    agent.reset(look.observation, look.info)
    grasp, name = agent.result.grasp if agent.result else None, look.subject.identity.name
    row: dict[str, Any] = {"object": name, "seed": seed, "planned": grasp is not None}
    if grasp is not None:
        certificate, env = grasp.certificate, look.env.unwrapped
        row |= {
            "load": certificate.load, "capacity": certificate.capacity, "assumed_mass": certificate.mass,
            "mass": float(env.simulation.object.mass),
        }  # fmt: skip
        observation = _lifted(look, agent)
        row["lifted"], rng = observation is not None, np.random.default_rng([seed, len(name)])
        pushed = None if observation is None else Pushed(env, agent, observation, certificate)
        row["pushes"] = [] if pushed is None else pushed.pushes(pushes, rng)
    look.env.close()
    return row


def _lifted(look: Look, agent: BilevelAgent) -> Any:
    """Carry the grasp out until the object is held; return the observation then, None if it never is."""
    observation = look.observation
    for _ in range(_STEPS):
        observation, _, over, _, info = look.env.unwrapped.step(agent.act(observation))
        if info["is_success"]:
            return observation
        if over:
            break
    return None


class Pushed(NamedTuple):
    """A held object to push."""

    env: Any
    agent: BilevelAgent
    observation: Any
    certificate: Certificate

    def pushes(self, count: int, rng: np.random.Generator) -> list[dict[str, Any]]:
        """Push in `count` directions from the same state."""
        state, certificate = self.env.get_state(), self.certificate
        claim = max((certificate.load - 1.0) * certificate.mass * GRAVITY, _LEAST_CLAIM)
        rows = []
        for _ in range(count):
            direction = rng.standard_normal(3)
            direction /= np.linalg.norm(direction)
            self.env.set_state(state)
            push = self._push(direction, claim)
            rows.append(
                {"direction": direction.tolist(), "claim": claim, "push": push, "ratio": push / claim}
            )
        return rows

    def _push(self, direction: Array, claim: float) -> float:
        """Return the largest force, N, that the grasp bore; the most if it never failed."""
        data, body, observation = self.env.data, self.env.simulation.body, self.observation
        before, force, agent = _in_hand(data, body), 0.0, deepcopy(self.agent)  # it remembers what it felt
        for k in range(1, round(_MOST / _GROWTH) + 1):
            data.xfrc_applied[body, :3] = k * _GROWTH * claim * direction
            observation, _, over, _, _ = self.env.step(agent.act(observation))
            if over or np.linalg.norm(_in_hand(data, body) - before) > _SLIP:
                break
            force = k * _GROWTH * claim
        data.xfrc_applied[:] = 0.0
        return force


def _in_hand(data: Any, body: int) -> Array:
    """Return where the object's middle is, as the palm sees it, m."""
    palm = data.site("palm")
    found: Array = palm.xmat.reshape(3, 3).T @ (data.xpos[body] - palm.xpos)
    return found


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the reliability: what was survived by what was claimed, and the share that failed below 0.8 of it."""
    planned = [row for row in rows if row["planned"]]
    pushed = [(row, push) for row in planned for push in row["pushes"]]
    claim, push = (np.array([p[key] for _, p in pushed]) for key in ("claim", "push"))
    whole = np.array([row["load"] * row["assumed_mass"] * GRAVITY for row, _ in pushed])
    below = [p for _, p in pushed if p["ratio"] < _BELOW]
    curve = []
    for low, high in pairwise(_EDGES):
        inside = (claim >= low) & (claim < high)
        if inside.any():
            quantiles = np.quantile(push[inside], [0.05, 0.5, 0.95])
            curve.append({
                "claims_n": [low, min(high, float(claim.max()))], "pushes": int(inside.sum()),
                "median_claim_n": float(np.median(claim[inside])), "survived_n_p5_median_p95": quantiles.tolist(),
                "below": float((push[inside] < _BELOW * claim[inside]).mean()),
            })  # fmt: skip
    return {
        "schema": 1, "grasps": len(planned), "unplanned": len(rows) - len(planned),
        "not_lifted": sum(not row["lifted"] for row in planned), "pushes": len(pushed),
        "failed_below_0.8_of_claim": len(below), "share_below": len(below) / max(len(pushed), 1),
        "share_at_three_claims": float((push >= (_MOST - 1e-9) * claim).mean()),
        "ratio_p5_median_p95": np.quantile(push / claim, [0.05, 0.5, 0.95]).tolist(),
        "ratio_of_whole_p5_median_p95": np.quantile(push / whole, [0.05, 0.5, 0.95]).tolist(),
        "correlation_of_logs": float(np.corrcoef(np.log(claim), np.log(np.maximum(push, 0.05)))[0, 1]),
        "curve": curve,
    }  # fmt: skip


def figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw what was survived over what was claimed."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    pushes = [p for row in rows if row["planned"] for p in row["pushes"]]
    fig, axes = plt.subplots(figsize=(5.2, 4.4), layout="constrained")
    claim, push = ([p[key] for p in pushes] for key in ("claim", "push"))
    axes.plot(claim, push, ".", ms=4, alpha=0.6)
    line = np.array([0.0, max(claim)])
    axes.plot(line, line, "k-", lw=1, label="as claimed")
    axes.plot(line, _BELOW * line, "r--", lw=1, label="0.8 of the claim")
    axes.plot(line, _MOST * line, color="0.7", lw=1, label="not pushed harder")
    axes.set(xlabel="claimed push: (load - 1) x assumed weight, N", ylabel="push survived, N")
    axes.legend(fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=110)


def main(argv: list[str] | None = None) -> int:
    """Make the grasps that are not in the file yet, and summarise."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--objects", nargs="+", default=["all20"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[40, 41])
    parser.add_argument("--pushes", type=int, default=6, help="directions a grasp")
    parser.add_argument("--out", type=Path, default=Path("runs/load"))
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(argv)
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "pushes.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {(row["object"], row["seed"]) for row in rows}
    jobs = [(target, seed) for seed in args.seeds for target in resolve_targets(args.objects)]
    for target, seed in tqdm(jobs, desc="grasps", unit="grasp", file=sys.stderr):
        if (target, seed) in done:
            continue
        rows.append(grasp_row(target, seed, args.pushes))
        with path.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
    found = summary(rows)
    print(json.dumps(found, indent=1))
    if args.json:
        write_json(args.json, found)
    if args.figure:
        figure(rows, args.figure)
    return 0


if __name__ == "__main__":
    sys.exit(main())
