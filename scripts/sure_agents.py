"""Does a grasp that is said to hold with 0.95 hold? Agents that abstain, and how much they answer and hold.

    dexgrasp evaluate --agents scripts.sure_agents:Sure --objects all20 --trials 25 --seed 77 --out runs/sure-lift
    dexgrasp evaluate --agents scripts.sure_agents:Sure --objects all20 --trials 25 --friction 0.5 --out runs/sure-05
    python scripts/sure_agents.py runs/sure-lift runs/sure-05

They plan as `dexgrasp plan --at-least` does and carry that one grasp out: nothing is turned, regrasped or set aside.
`Sure` asks for 0.95, `Unsure` for nothing; `SureSlippery` is told a friction of 0.35.
"""

import argparse
from collections import Counter
from pathlib import Path

from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.planning.sure import UNSURE
from dexgrasp.runs.lines import Row, read_lines


class Unsure(BilevelAgent):
    """Carries out the grasp that the planner finds, whatever its probability."""

    at_least = 0.0
    friction: float | None = None

    def __init__(self) -> None:
        """Prepare the planner."""
        settings = PlannerSettings.of(self.friction, self.at_least)
        super().__init__(settings=settings, regrasps=0, turns=False, moves=0)


class Sure(Unsure):
    """Carries out a grasp that holds with 0.95, or none."""

    at_least = 0.95


class SureSlippery(Sure):
    """The same, told that surfaces have friction 0.35."""

    friction = 0.35


def summary(rows: list[Row]) -> str:
    """Return a line: how many scenes, how many answered, how many of these held, and what was said of them."""
    answered = [row for row in rows if "holds_probability" in row["details"]]
    unsure = sum(UNSURE in str(row["reason"]) for row in rows)
    held, said = (
        sum(row["success"] for row in answered),
        [row["details"]["holds_probability"]["lifted"]["value"] for row in answered],
    )
    low, high = wilson_interval(held, len(answered))
    reasons = Counter(row["reason"] for row in answered if not row["success"])
    return (
        f"{len(rows)} scenes, {len(answered)} answered ({len(answered) / len(rows):.1%}), {unsure} not sure enough, "
        f"{len(rows) - len(answered) - unsure} without a grasp; held {held} ({held / max(len(answered), 1):.1%}, "
        f"[{low:.1%}, {high:.1%}]), said {sum(said) / max(len(said), 1):.3f}; {dict(reasons)}"
    )


def main() -> None:
    """Say how it went, agent by agent and protocol by protocol."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="+", type=Path)
    for run in parser.parse_args().runs:
        rows = read_lines(run / "trials.jsonl", "trial", lambda row: None)
        for key in sorted({(row["agent"], row["protocol"]) for row in rows}):
            own = [row for row in rows if (row["agent"], row["protocol"]) == key]
            print(f"{run.name}, {key[0]}, {key[1]}: {summary(own)}")


if __name__ == "__main__":
    main()
