"""Record demonstrations, clone them, and score the clone beside the planner: the template for an agent of your own.

python examples/clone_the_planner.py runs/clone --whole    some hours; goes on where it was stopped
python examples/clone_the_planner.py                       minutes: tries it
"""

import sys
from pathlib import Path

from dexgrasp.data.demonstrations.generate import generate
from dexgrasp.data.demonstrations.settings import DemoSettings
from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.report.tables import rate_words
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.learning.imitation.bc_training import VIEWS
from dexgrasp.learning.imitation.settings import BcSettings

TEACHER = "dexgrasp.agents.teacher:Teacher"  # or your own: "my_package.planners:MyPlanner"
VIEW = "state"  # or "cloud": what the clone sees


def clone(out: Path, objects: list[str], episodes: int, epochs: int, test: list[str], trials: int) -> None:
    """Do all of it; `episodes` are scenes of each object, `trials` those of each test object."""
    settings = DemoSettings.of(objects, agent=TEACHER, episodes=episodes, noise=0.03)
    made = generate(settings, out / "demos")
    print(f"{made['episodes']} of {made['tried']} scenes became demonstrations")

    policy = out / "policy"
    trained = VIEWS[VIEW]([out / "demos"], BcSettings(view=VIEW, epochs=epochs), policy).run()
    print(f"loss {trained.curve[-1]['loss']:.3f} after {trained.seconds:.0f} s; the policy is {policy}")

    scored = EvaluationSettings.of([str(policy), "hardcoded", "bilevel"], test, trials=trials)
    for name, figures in evaluate(scored, out / "scores")["agents"].items():
        print(f"{name}: {figures['successes']} of {figures['trials']}, {rate_words(figures)}")


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/clone_tried")
    if "--whole" in sys.argv:
        clone(folder, ["varied-0..19"], episodes=20, epochs=10, test=["seen"], trials=3)
    else:
        clone(folder, ["sugar_box"], episodes=2, epochs=1, test=["sugar_box"], trials=1)
