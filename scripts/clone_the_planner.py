"""Record demonstrations, clone them, and score the clone beside the planner: the template for your own agent.

    python scripts/clone_the_planner.py --out runs/clone
    python scripts/clone_the_planner.py --agent my_package.planners:MyPlanner --objects varied-0..59 --epochs 16

Everything goes on where it was stopped when the same command is given again.
"""

import sys
from pathlib import Path
from typing import Annotated

from dexgrasp.cli.command import Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.data.demonstrations.generate import generate
from dexgrasp.data.demonstrations.settings import DemoSettings
from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.report.tables import rate_words
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.learning.imitation.bc_tasks import VIEWS
from dexgrasp.learning.imitation.settings import BcSettings
from dexgrasp.learning.training.gradient_training import GradientTraining
from dexgrasp.runs.pool import Backend
from dexgrasp_env.valid import Count, one_of


class Clone(Script):
    """Options.

    Attributes:
        agent: who demonstrates.
        objects: to learn on.
        episodes: scenes of each object.
        noise: on what is demonstrated.
        view: what the clone sees.
        epochs: of training.
        test: objects to score on.
        beside: agents to score beside.
        trials: on each of them.
        out: folder.
    """

    agent: str = "dexgrasp.agents.teacher:Teacher"
    objects: tuple[str, ...] = ("varied-0..19",)
    episodes: Count = 20
    noise: float = 0.03
    view: Annotated[str, one_of(("state", "cloud"))] = "state"
    epochs: Count = 10
    test: tuple[str, ...] = ("seen",)
    beside: Annotated[tuple[str, ...], {"nargs": "*"}] = ("hardcoded", "bilevel")
    trials: Count = 3
    backend: Backend = Backend()
    out: Folder = Path("runs/clone")

    def run(self) -> int:
        demos, clone = self.out / "demos", self.out / "policy"
        settings = DemoSettings.of(self.objects, agent=self.agent, episodes=self.episodes, noise=self.noise)
        made = generate(settings, demos, backend=self.backend)
        print(f"{made['episodes']} of {made['tried']} scenes became demonstrations")

        task = VIEWS[self.view]([demos], BcSettings(view=self.view, epochs=self.epochs))
        trained = GradientTraining(task, clone).run()
        print(f"loss {trained.curve[-1]['loss']:.3f} after {trained.seconds:.0f} s; the policy is {clone}")

        scored = EvaluationSettings.of([str(clone), *self.beside], self.test, trials=self.trials)
        agents = evaluate(scored, self.out / "scores", backend=self.backend)["agents"]
        for name, figures in agents.items():
            print(f"{name}: {figures['successes']} of {figures['trials']}, {rate_words(figures)}")
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Clone))
