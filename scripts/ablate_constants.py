"""What tuned constants are worth: agent `bilevel` with and without a group of them, on the same scenes.

    python scripts/ablate_constants.py --groups rises patience --out runs/constants

Run it in the repository's root. Every group is an agent of `evaluate` (`scripts.ablate_constants:no_rises`) beside
`bilevel`, each with a run below --out that goes on when the same command is given again. Printed is what is lost
without the group (b; a has it), with Newcombe's 95 % interval for paired rates; `docs/constants.md` has the constants.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Annotated, Any

from dexgrasp.agents.bilevel import BilevelAgent, State
from dexgrasp.cli.command import Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.comparison import compare_agents
from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.motion.carrying import GuardedCarry
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.runs.pool import Backend
from dexgrasp_env.valid import Count, Natural, one_of

SEED = 7000
"""Of scenes that nothing was tuned on."""


def changed(
    settings: PlannerSettings | None = None, regrasps: int = 2, turns: bool = True, **planner: Any
) -> BilevelAgent:
    """Return the agent with other settings; `settings` are those that a protocol asks for."""
    return BilevelAgent(
        settings=replace(settings or PlannerSettings(), **planner), regrasps=regrasps, turns=turns
    )


class Unfeeling(BilevelAgent):
    """Never takes an object for lost."""

    def _next(self, state: State, observation: Mapping[str, Any]) -> State:
        return state if isinstance(state.motion, GuardedCarry) else super()._next(state, observation)


no_rises = partial(changed, rises=(0.0,))
no_patience = partial(changed, patience=0)
no_parts = partial(changed, most_parts=1)
no_turns = partial(changed, turns=False)
no_lost = Unfeeling
no_regrasps = partial(changed, regrasps=0)
no_breadths = partial(changed, breadths=(1.0,), patience=0)
no_place_error = partial(changed, place_error=0.0)
no_squeeze_reserve = partial(changed, friction_squeeze=PlannerSettings().friction_hold)
no_ranking = partial(changed, candidates=1, firm_load=0.0)

GROUPS = {
    "rises": "the hand opens straight back from the surface, never upwards besides",
    "patience": "no more rounds where no grasp bears the assumed weight",
    "parts": "every object is planned on the hull of its cloud",
    "turns": "what is lifted is not turned",
    "lost": "a lost object is not noticed; without a grasp it still looks again",
    "regrasps": "one look, one grasp",
    "breadths": "one round of proposals",
    "place_error": "the surface is taken to be where it is seen",
    "squeeze_reserve": "the squeeze counts on the friction that the certificate does",
    "ranking": "the first grasp that is feasible",
}
"""Name, of an agent `no_<name>` above, and what that does."""
FITTED = tuple(GROUPS)[:5]
"""To single objects."""


class Ablate(Script):
    """Runs what is missing, and prints.

    Attributes:
        trials: of each object under each of the protocols.
        out: folder of the run.
    """

    groups: tuple[Annotated[str, one_of(GROUPS)], ...] = FITTED
    objects: tuple[str, ...] = ("all20",)
    protocols: Annotated[tuple[str, ...], "--protocol"] = ("robust",)
    trials: Count = 3
    seed: Natural = SEED
    backend: Backend = Backend()
    out: Folder

    def run(self) -> int:
        for group in self.groups:
            print(json.dumps(self.measured(group)), flush=True)
        return 0

    def measured(self, group: str) -> dict[str, Any]:
        """Return what it costs to leave a group out; what is missing of the trials is run."""
        agents = {"bilevel": "bilevel", f"scripts.ablate_constants:no_{group}": group}
        for agent, folder in agents.items():  # a run each, so that groups may be added later
            settings = EvaluationSettings.of(
                [agent], self.objects, trials=self.trials, seed=self.seed, protocols=self.protocols
            )
            evaluate(settings, self.out / folder, backend=self.backend)
        found = compare_agents([self.out / folder for folder in agents.values()], *agents)
        low, high = found["ci95"]
        kept = ("trials", "scenes", "rate_a", "rate_b", "difference", "ci95", "only_a", "only_b", "p_value")
        verdict = (
            "keep"
            if low > 0
            else "may go: a loss of more than a point is excluded"
            if high <= 0.01
            else "open"
        )
        return {
            "group": group,
            "without": GROUPS[group],
            **{key: found[key] for key in kept},
            "verdict": verdict,
        }


if __name__ == "__main__":
    sys.exit(run_script(Ablate))
