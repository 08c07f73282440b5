"""Compare engines: set-points replayed in MuJoCo, Bullet and Drake, whose solvers and contacts share no code.

    pip install -c constraints.txt pybullet drake
    dexgrasp export grasps/pear/grasp.json --format mjcf --out robot/pear
    python scripts/compare_engines.py trajectory robot/pear --engine drake --replay 5
    python scripts/compare_engines.py trials OUT --agents bilevel hardcoded bc --objects all20 --trials 1 --seed 0

The bodies are those of the scene as MuJoCo compiles it: shapes, inertias, joints, friction, servos, torque limits.
All is played open loop, and the object has to be 10 cm up in the end. `trajectory` plays what was exported, some ten
seconds each time; its exit code is 0 if every replay holds. `trials` runs those of agents, from scenes varied as
their protocol has it, and plays the set-points of each. It prints in how many trials each engine has MuJoCo's
outcome, where they differ, and, over agents, Pearson's correlation of success rates and the mean maximum rank
violation (Li et al. 2024, "Evaluating real-world robot manipulation policies in simulation", Eq. 1). OUT is an
evaluation's folder; what was stopped goes on.
"""

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import mujoco
import numpy as np
from engines.scene import PACKAGES, SetPoints, make_world, play
from tqdm import tqdm

from dexgrasp.agent import Env
from dexgrasp.cli.command import Argument, CellOptions, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.protocol import get_protocol
from dexgrasp.evaluation.settings import EvaluationSettings, TrialSpec, plan_trials
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.evaluation.store import TrialStore
from dexgrasp.evaluation.trial_runner import TrialRunner
from dexgrasp.export.read import Recording, read_trajectory
from dexgrasp.export.replay import HEIGHT, HOLD, displace, load_scene, set_points
from dexgrasp_env.arrays import Array, Fields, Index
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Count, Natural, one_of

Engine = Annotated[str, one_of(PACKAGES)]
_HOLD = 2.8  # s at the end in which the object has to be up: a trial ends when it has been so for 3


# -- what was exported -------------------------------------------------------------------------------------------------


def replay(recording: Recording, scene: Path, engine: str, rng: np.random.Generator | None = None) -> float:
    """Play a trajectory in an engine; return the object's least height, m, after the lift.

    Args:
        recording: as read.
        scene: `scene.xml` of `export --format mjcf`; the object starts at the keyframe `start`.
        engine: mujoco, bullet or drake.
        rng: draws the object's error; None leaves the object where it is.

    Raises:
        InputError: if the scene is none, or the engine is not installed.
    """
    model, data = load_scene(scene, recording)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    pose = data.qpos[int(model.joint("object").qposadr[0]) :][:7].copy()
    if rng is not None:
        displace(pose, rng)
    times, end = np.union1d(recording.arm.times, recording.hand.times), float(recording.arm.times[-1])
    points = SetPoints(times, np.array([set_points(recording, t) for t in times.tolist()]), end, end + HOLD)
    with contextlib.closing(make_world(engine, model, points.rows[0], pose)) as world:
        return play(world, points)


class ReplayTrajectory(Script, CellOptions):
    """Replay a trajectory; exit code 1 unless every replay holds.

    Attributes:
        trajectory: a folder of `dexgrasp export --format mjcf`.
        engine: that plays it.
        replay: times.
        seed: of the object's errors: 3 mm and 1 degree.
    """

    trajectory: Argument[Folder]
    engine: Engine = "bullet"
    replay: Count = 1
    seed: Natural = 0

    def run(self) -> int:
        recording, scene = read_trajectory(self.trajectory, self.cell), self.trajectory / "scene.xml"
        held = 0
        for k in tqdm(range(self.replay), unit="replay", leave=False):
            rng = np.random.default_rng([self.seed, k])
            held += replay(recording, scene, self.engine, rng) >= HEIGHT
        print(
            f"held in {held} of {self.replay} open-loop replays in {self.engine}, the object 3 mm and 1 deg off"
        )
        return int(held < self.replay)


# -- trials of agents --------------------------------------------------------------------------------------------------


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

    def height_in(self, engine: str) -> float:
        """Play what was recorded in an engine; return the object's least height, m, at the end."""
        if not self.rows:
            return 0.0
        dt = self.model.opt.timestep
        end = len(self.rows) * dt
        points = SetPoints(np.arange(len(self.rows)) * dt, np.array(self.rows), end - _HOLD, end)
        with contextlib.closing(make_world(engine, self.model, self.start, self.pose)) as world:
            return play(world, points)


class EngineRunner(TrialRunner):
    """Runs trials whose set-points can be played again."""

    def make_env(self, spec: TrialSpec) -> Env:
        """Return the protocol's environment, recorded."""
        return Recorder(super().make_env(spec))

    def heights(self, spec: TrialSpec, engines: tuple[str, ...]) -> dict[str, float]:
        """Play a trial that was just run in engines; return the object's heights, m."""
        recorder: Any = self._env(spec)
        return {engine: recorder.height_in(engine) for engine in engines}


class CompareEngines(Script):
    """Run trials of agents, replay their set-points in engines, and print the tables.

    Attributes:
        out: folder of the trials.
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
    trials: Count = 1
    seed: Natural = 0
    protocols: Annotated[tuple[str, ...], "--protocol", "PROTOCOL"] = ("lift",)
    engines: tuple[Engine, ...] = tuple(PACKAGES)

    def run(self) -> int:
        settings = EvaluationSettings.of(
            self.agents, self.objects, trials=self.trials, seed=self.seed, protocols=self.protocols
        )
        for name in settings.parts:
            if get_protocol(name).scene.keys() & {"disturbance", "clutter"} or get_protocol(name).places:
                raise InputError(
                    f"protocol {name!r} does more than set-points say: take lift or slippery@0.35"
                )
        runner = EngineRunner(settings)
        store = TrialStore(self.out, settings.identity() | {"engines": list(self.engines)})
        with contextlib.closing(store):
            left = [spec for spec in plan_trials(settings) if spec.key not in store.finished]
            for spec in tqdm(left, unit="trial"):
                row, grasp = runner.run(spec)
                store.append(row | {"engines": runner.heights(spec, self.engines)}, grasp)
        print("\n".join(report(store.rows, self.engines)))
        return 0


def report(rows: list[Fields], engines: tuple[str, ...]) -> Iterator[str]:
    """Yield the tables of agreement, of differences, and of agents' rates."""
    agents = sorted({row["agent"] for row in rows})
    of, env = np.array([row["agent"] for row in rows]), np.array([row["success"] for row in rows])
    held = {engine: np.array([row["engines"][engine] >= HEIGHT for row in rows]) for engine in engines}
    real, *others = (np.array([won[of == a].mean() for a in agents]) for won in (env, *held.values()))
    yield "| engine | same outcome | Pearson | MMRV | " + " | ".join(f"`{a}`" for a in agents) + " |"
    yield "|---" * (4 + len(agents)) + "|"
    for engine, rates in zip(engines, others, strict=True):
        same = int((held[engine] == env).sum())
        low, high = wilson_interval(same, len(rows))
        spread = len(agents) > 1 and real.std() > 0 and rates.std() > 0
        pearson = f"{np.corrcoef(real, rates)[0, 1]:.3f}" if spread else "-"
        told = " | ".join(f"{100 * rate:.1f}" for rate in rates)
        yield (
            f"| {engine} | {same} of {len(rows)} [{100 * low:.0f}, {100 * high:.0f}] | {pearson} | "
            f"{rank_violation(real, rates):.3f} | {told} |"
        )
    yield "environment: " + ", ".join(f"{a} {100 * rate:.1f} %" for a, rate in zip(agents, real, strict=True))
    for k, row in enumerate(rows):
        if other := [engine for engine in engines if held[engine][k] != env[k]]:
            heights = ", ".join(f"{engine} {100 * row['engines'][engine]:.1f} cm" for engine in engines)
            place = f"{row['protocol']} {row['agent']} {row['object']} {row['trial']}"
            yield f"{place}: environment {'held' if env[k] else 'lost'}, not so {', '.join(other)} ({heights})"


def rank_violation(real: Array, other: Array) -> float:
    """Return the mean maximum rank violation of rates (k,) against those (k,) of another engine."""
    gap = np.abs(real[:, None] - real[None, :])
    wrong = (real[:, None] < real[None, :]) != (other[:, None] < other[None, :])
    return float((gap * wrong).max(axis=1).mean())


if __name__ == "__main__":
    sys.exit(run_script({"trajectory": ReplayTrajectory, "trials": CompareEngines}))
