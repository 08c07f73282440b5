"""Compares engines: the set-points of agents' trials in MuJoCo, played again in MuJoCo, Bullet and Drake.

    pip install -c constraints.txt pybullet drake
    python scripts/compare_engines.py OUT --agents bilevel hardcoded bc --objects all20 --trials 1 --seed 0

Each trial starts from the same scene, varied as its protocol has it, and is played open loop. The object has to be
10 cm up in the end. Prints in how many trials each engine has MuJoCo's outcome, where they differ, and, over agents,
Pearson's correlation of success rates and the mean maximum rank violation (Li et al. 2024, "Evaluating real-world robot
manipulation policies in simulation", Eq. 1). Rows go to OUT/rows.jsonl; a run that was stopped goes on.
"""

import contextlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import mujoco
import numpy as np
from engines.scene import PACKAGES, SetPoints, make_world, play
from tqdm import tqdm

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.protocol import get_protocol, trial_seeds
from dexgrasp.evaluation.settings import EvaluationSettings, plan_trials
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.export.replay import HEIGHT
from dexgrasp_env.arrays import Array, Fields, Index
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import one_of

_KEY = ("protocol", "agent", "object", "trial")
_HOLD = 2.8  # s at the end in which the object has to be up: a trial ends when it has been so for 3


class Recorder(gym.Wrapper[Any, Any, Any, Any]):
    """Environment whose set-points of every physics step are kept, with the scene that they began in."""

    def reset(self, **arguments: Any) -> Any:
        """Reset, and keep what the scene is then."""
        answer = self.env.reset(**arguments)
        scene = self.unwrapped.simulation
        scene.physics = self
        self.rows: list[Array] = []
        self.model: mujoco.MjModel = scene.model
        self.pose = scene.object_pose()
        self.start = scene.data.qpos[: scene.cell.robot.dof].copy()
        return answer

    def advance(self, scene: Any, rows: Array) -> Index:
        """Advance a scene by a control step and keep its set-points (1, k, n)."""
        self.rows.extend(rows[0].copy())
        scene.physics = None
        warnings: Index = scene.step(rows, None, np.zeros(1, np.intp))
        scene.physics = self
        return warnings

    def points(self) -> SetPoints:
        """Return what was recorded."""
        dt = self.model.opt.timestep
        end = len(self.rows) * dt
        return SetPoints(np.arange(len(self.rows)) * dt, np.array(self.rows), end - _HOLD, end)


class CompareEngines(Script):
    """Plays, prints the tables; 2 for bad input.

    Attributes:
        out: folder of the rows.
        agents: names (dexgrasp list agents), or those that `evaluate` takes.
        objects: objects, sets, mesh files.
        trials: of each agent on each object.
        seed: of all.
        protocols: of those in which nothing pushes the object and nothing else stands on the table.
        engines: mujoco, bullet, drake.
    """

    out: Argument[Folder]
    agents: Annotated[tuple[str, ...], "AGENT"] = ("bilevel", "hardcoded", "bc")
    objects: Annotated[tuple[str, ...], "OBJECT"] = ("all20",)
    trials: int = 1
    seed: int = 0
    protocols: Annotated[tuple[str, ...], "--protocol", "PROTOCOL"] = ("lift",)
    engines: tuple[Annotated[str, one_of(PACKAGES)], ...] = tuple(PACKAGES)

    def run(self) -> int:
        settings = EvaluationSettings.of(
            self.agents, self.objects, trials=self.trials, seed=self.seed, protocols=self.protocols
        )
        for name in settings.parts:
            if get_protocol(name).scene.keys() & {"disturbance", "clutter"} or get_protocol(name).places:
                raise InputError(
                    f"protocol {name!r} does more than set-points say: take lift or slippery@0.35"
                )
        self.out.mkdir(parents=True, exist_ok=True)
        path = self.out / "rows.jsonl"
        runner, specs = TrialRunner(settings), {spec.key: spec for spec in plan_trials(settings)}
        rows = {key: row for key, row in self._played(path).items() if key in specs}
        with path.open("a") as file:
            for key in tqdm([key for key in specs if key not in rows], unit="trial"):
                row = dict(zip(_KEY, key, strict=True)) | {"seed": self.seed}
                rows[key] = row | self._outcomes(runner, specs[key])
                print(json.dumps(rows[key]), file=file, flush=True)
        print("\n".join(report(list(rows.values()), self.engines)))
        return 0

    def _played(self, path: Path) -> dict[Any, Fields]:
        """Return the rows of a file that are of this seed and have all engines, by the key of their trial."""
        lines = path.read_text().splitlines() if path.exists() else []
        rows = [row for row in map(json.loads, lines) if row["seed"] == self.seed]
        return {
            tuple(row[name] for name in _KEY): row for row in rows if {*self.engines} <= row["held"].keys()
        }

    def _outcomes(self, runner: TrialRunner, spec: Any) -> Fields:
        """Run a trial, then play its set-points in every engine; return who held and how far up."""
        env = Recorder(runner.make_env(spec))
        seeds = trial_seeds(self.seed, spec.target, spec.trial)
        with contextlib.closing(env):
            outcome, _ = run_trial(env, runner.agent(spec), seeds, name=spec.agent)
            heights = dict.fromkeys(self.engines, 0.0)
            if env.rows:
                points = env.points()
                for engine in self.engines:
                    with contextlib.closing(make_world(engine, env.model, env.start, env.pose)) as world:
                        heights[engine] = play(world, points)
        held = {engine: height >= HEIGHT for engine, height in heights.items()}
        return {"env": outcome.success, "held": held, "height": heights}


def report(rows: list[Fields], engines: tuple[str, ...]) -> Iterator[str]:
    """Yield the tables of agreement, of differences, and of agents' rates."""
    agents = sorted({row["agent"] for row in rows})
    env = np.array([np.mean([r["env"] for r in rows if r["agent"] == a]) for a in agents])
    yield "| engine | same outcome | Pearson | MMRV | " + " | ".join(f"`{a}`" for a in agents) + " |"
    yield "|---" * (4 + len(agents)) + "|"
    for engine in engines:
        same = sum(row["held"][engine] == row["env"] for row in rows)
        low, high = wilson_interval(same, len(rows))
        rates = np.array([np.mean([r["held"][engine] for r in rows if r["agent"] == a]) for a in agents])
        spread = len(agents) > 1 and env.std() > 0 and rates.std() > 0
        pearson = f"{np.corrcoef(env, rates)[0, 1]:.3f}" if spread else "-"
        told = " | ".join(f"{100 * rate:.1f}" for rate in rates)
        yield (
            f"| {engine} | {same} of {len(rows)} [{100 * low:.0f}, {100 * high:.0f}] | {pearson} | "
            f"{rank_violation(env, rates):.3f} | {told} |"
        )
    yield "environment: " + ", ".join(f"{a} {100 * rate:.1f} %" for a, rate in zip(agents, env, strict=True))
    for row in rows:
        if other := [engine for engine in engines if row["held"][engine] != row["env"]]:
            heights = ", ".join(f"{engine} {100 * row['height'][engine]:.1f} cm" for engine in engines)
            place = f"{row['protocol']} {row['agent']} {row['object']} {row['trial']}"
            yield f"{place}: environment {'held' if row['env'] else 'lost'}, not so {', '.join(other)} ({heights})"


def rank_violation(real: Array, other: Array) -> float:
    """Return the mean maximum rank violation of rates (k,) against those (k,) of another engine."""
    gap = np.abs(real[:, None] - real[None, :])
    wrong = (real[:, None] < real[None, :]) != (other[:, None] < other[None, :])
    return float((gap * wrong).max(axis=1).mean())


if __name__ == "__main__":
    sys.exit(run_script(CompareEngines))
