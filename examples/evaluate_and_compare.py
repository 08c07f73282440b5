"""Two agents on the same scenes: evaluated, and compared pair by pair."""

from pathlib import Path

from dexgrasp.evaluation.comparison import compare_agents
from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.settings import EvaluationSettings

# Play two scenes of one object with each agent; the same program again continues or reads what is there.
settings = EvaluationSettings.of(["random", "hardcoded"], ["sugar_box"], trials=2, seed=5)
summary = evaluate(settings, Path("out/first"), progress=False)
for name, figures in summary["agents"].items():
    print(name, figures["successes"], "of", figures["trials"], figures["ci95"])
comparison = compare_agents([Path("out/first")], "hardcoded", "random")
print({key: comparison[key] for key in comparison if key in ("trials", "scenes", "agents")})
