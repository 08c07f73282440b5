"""Does a grasp hold by itself? Pushes of the protocol, with the agent's command kept as it was when they began.

    python scripts/frozen_setpoints.py --seeds 1000 1001 1002 --out runs/frozen

The scenes are those of `dexgrasp evaluate --protocol pushed@1 --seed S`. From the first push on, the action before it
is repeated whatever the agent commands: nothing then reacts. One line a trial goes into DIR/trials.jsonl; those that
are there are not made again.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

from dexgrasp.evaluation.protocol import get_protocol, trial_seeds
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.registry import make_agent
from dexgrasp_env.objects.load import resolve_targets


class Frozen(gym.Wrapper[Any, Any, Any, Any]):
    """Repeats the last action from before the first push.

    Attributes:
        frozen: control steps for which it did.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.frozen = 0
        self._last: Any = None

    def step(self, action: Any) -> Any:
        """Pass the action on, or the one that is kept."""
        simulation: Any = self.unwrapped
        pushed = np.any(simulation.data.xfrc_applied[simulation.simulation.body])
        if self._last is not None and (pushed or self.frozen):
            self.frozen += 1
        else:
            self._last = np.array(action)
        return self.env.step(self._last)


def trial_row(target: str, seed: int, trial: int, agent: Any, protocol_name: str) -> dict[str, Any]:
    """Run one trial; return a line of trials.jsonl."""
    protocol = get_protocol(protocol_name)
    env = Frozen(gym.make(protocol.env_id, objects=target, **protocol.scene, **agent.env_settings))
    outcome, _ = run_trial(env, agent, trial_seeds(seed, target, trial))
    env.close()
    return {
        "object": target, "seed": seed, "trial": trial, "success": outcome.success, "reason": outcome.reason,
        "frozen_steps": env.frozen,
    }  # fmt: skip


def main() -> int:
    """Run the trials that are missing, and print how many succeed."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--agent", default="bilevel")
    parser.add_argument("--objects", nargs="+", default=["all20"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--trials", type=int, default=3, help="scenes of an object and seed")
    parser.add_argument("--protocol", default="pushed@1")
    parser.add_argument("--out", type=Path, default=Path("runs/frozen"))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    path, agent = args.out / "trials.jsonl", make_agent(args.agent)
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    rows = [row for row in rows if (row["agent"], row["protocol"]) == (args.agent, args.protocol)]
    done = {(row["object"], row["seed"], row["trial"]) for row in rows}
    jobs = [(o, s, t) for o in resolve_targets(args.objects) for s in args.seeds for t in range(args.trials)]
    with path.open("a") as file:
        for target, seed, trial in tqdm([job for job in jobs if job not in done], unit="trial"):
            row = trial_row(target, seed, trial, agent, args.protocol)
            rows.append({"agent": args.agent, "protocol": args.protocol} | row)
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
    held = sum(row["success"] for row in rows)
    low, high = wilson_interval(held, len(rows))
    kept = sum(row["frozen_steps"] > 0 for row in rows)
    share = f"{100 * held / len(rows):.1f} % [{100 * low:.0f}, {100 * high:.0f}]"
    print(f"{held}/{len(rows)} held, {share}; frozen in {kept}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
