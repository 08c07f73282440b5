"""Does a grasp that is said to hold with 0.95 hold? Agents that abstain, and how much they answer and hold.

    dexgrasp evaluate --agents scripts.sure_agents:Sure --objects all20 --trials 25 --seed 77 --out runs/sure-lift
    dexgrasp evaluate --agents scripts.sure_agents:Sure --objects all20 --trials 25 --friction 0.5 --out runs/sure-05
    python scripts/sure_agents.py runs/sure-lift runs/sure-05

They plan as `dexgrasp plan --at-least` does and carry that one grasp out: nothing is turned, regrasped or set aside.
`Sure` asks for 0.95, `Unsure` for nothing; `SureSlippery` is told a friction of 0.35.
"""

import sys

from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.report.tables import rate_words
from dexgrasp.evaluation.store import read_rows
from dexgrasp.evaluation.summary import grouped, summarise_agent
from dexgrasp.planning.diverse import UNSURE
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Fields


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


def summary(rows: list[Fields]) -> str:
    """Return a line: how many scenes, how many answered, how many of these held, and what was said of them."""
    answered = [row for row in rows if "holds_probability" in row["details"]]
    said = [row["details"]["holds_probability"]["lifted"]["value"] for row in answered]
    unsure, found = sum(UNSURE in str(row["reason"]) for row in rows), summarise_agent(answered)
    return (
        f"{len(rows)} scenes, {len(answered)} answered ({len(answered) / len(rows):.1%}), {unsure} not sure enough, "
        f"{len(rows) - len(answered) - unsure} without a grasp; held {found['successes']} ({rate_words(found)}), "
        f"said {sum(said) / max(len(said), 1):.3f}; {found['failures']}"
    )


class Summary(Script):
    """Says how it went, agent by agent and protocol by protocol."""

    runs: Argument[tuple[Folder, ...]]

    def run(self) -> int:
        for run in self.runs:
            for agent, rows in grouped(read_rows(run), "agent").items():
                for protocol, own in grouped(rows, "protocol").items():
                    print(f"{run.name}, {agent}, {protocol}: {summary(own)}")
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Summary))
