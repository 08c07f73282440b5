"""Record demonstrations, clone them, and score the clone beside the planner: the template for your own agent.

    python scripts/clone_the_planner.py --out runs/clone
    python scripts/clone_the_planner.py --agent my_package.planners:MyPlanner --objects varied-0..59 --epochs 16

Everything goes on where it was stopped when the same command is given again.
"""

import argparse
from pathlib import Path

from dexgrasp.demos.generate import generate
from dexgrasp.demos.settings import DemoSettings
from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.imitation.cloning import Cloning
from dexgrasp.imitation.settings import BcSettings
from dexgrasp.runs.pool import Backend


def main(argv: list[str] | None = None) -> dict[str, float]:
    """Return the success of each agent."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--agent", default="dexgrasp.agents.teacher:Teacher", help="who demonstrates")
    parser.add_argument("--objects", nargs="+", default=["varied-0..19"], help="to learn on")
    parser.add_argument("--episodes", type=int, default=20, help="scenes of each object")
    parser.add_argument("--noise", type=float, default=0.03, help="on what is demonstrated")
    parser.add_argument("--view", choices=("state", "cloud"), default="state", help="what the clone sees")
    parser.add_argument("--epochs", type=int, default=10, help="of training")
    parser.add_argument("--test", nargs="+", default=["seen"], help="objects to score on")
    parser.add_argument(
        "--beside", nargs="*", default=["hardcoded", "bilevel"], help="agents to score beside"
    )
    parser.add_argument("--trials", type=int, default=3, help="on each of them")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, default=Path("runs/clone"), help="folder")
    args = parser.parse_args(argv)

    demos, clone = args.out / "demos", args.out / "policy"
    settings = DemoSettings.of(args.objects, agent=args.agent, episodes=args.episodes, noise=args.noise)
    backend = Backend(workers=args.workers)
    made = generate(settings, demos, backend=backend)
    print(f"{made['episodes']} of {made['tried']} scenes became demonstrations")

    trained = Cloning([demos], clone, BcSettings(view=args.view, epochs=args.epochs)).run()
    print(f"loss {trained.curve[-1]['loss']:.3f} after {trained.seconds:.0f} s; the policy is {clone}")

    scored = EvaluationSettings.of([str(clone), *args.beside], args.test, trials=args.trials)
    agents = evaluate(scored, args.out / "scores", backend=backend)["agents"]
    for name, figures in agents.items():
        low, high = figures["ci95"]
        print(f"{name}: {figures['successes']} of {figures['trials']}, 95 % within {low:.2f} to {high:.2f}")
    return {name: figures["rate"] for name, figures in agents.items()}


if __name__ == "__main__":
    main()
