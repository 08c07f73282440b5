"""Episodes that the probability of a grasp is fitted on: plans, good and deliberately worse, and how they held.

    python scripts/probability_data.py OUT --outside sets/outside/develop.json --scenes 3000

Scene k is always the same one: a shape of `varied-20000..21999` or of the 700 development shapes of `outside`, how it
is seen (four cameras, one, or miscalibrated ones), who plans (`bilevel`; one of twelve grasps of `plan --count 12`; the
ablations `cvae_kinematics` and `cvae`) and which friction and mass the planner is told, if any. What is planned is
carried out at four true frictions (0.3 to 0.9) and masses (0.5 to 3 times the object's own), as its file states it:
neither turned nor grasped again. An episode is `pushed@1` at that friction; where it fails, the same grasp is lifted
without pushes as well. OUT has a file a scene, with all that features are computed from; those that are there are not
made again.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

import dexgrasp_env  # noqa: F401  (registers the environment)
from dexgrasp.agent import Agent, Observation, public_info
from dexgrasp.cli.command import Argument, File, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.protocol import TrialSeeds
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.geometry.request import GraspRequest
from dexgrasp.motion.carrying import PickUp
from dexgrasp.planning.plan_scene import plan_scene, start_of
from dexgrasp.planning.result import Planned, PlanResult
from dexgrasp.registry import make_agent
from dexgrasp.runs.pool import Backend
from dexgrasp.runs.progress import progress_bar
from dexgrasp.runs.shards import bytes_of, is_shard, make_missing, write_shard
from dexgrasp_env.arrays import Array, Arrays
from dexgrasp_env.objects.load import resolve_targets
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.valid import Count

SEED = 2828
VARIED = "varied-20000..21999"
FRICTIONS, MASSES = (0.3, 0.9), (0.5, 3.0)  # coefficient; times the object's own
SCENES = 4  # of a shape
CONDITIONS = (
    4  # that a plan is carried out in; the first has what the planner counts on, and the object's own mass
)
KEY = "probability-1"
_FRICTION = 0.7  # what a planner counts on that is told nothing
_SEEN: dict[str, tuple[float, dict[str, Any]]] = {  # share of the scenes, and what makes them
    "cameras": (0.76, {}),
    "one_view": (0.12, {"views": 1}),
    "miscalibrated": (0.12, {"calibration": {"position": 0.01, "rotation": 0.035}}),
}
_PLANNERS = {"bilevel": 0.5, "later": 0.3, "cvae_kinematics": 0.14, "cvae": 0.06}
_LATER = 12
_PUSHED = {"disturbance": {"kind": "pushed", "size": 1.0}, "max_episode_steps": 380}


class Job(NamedTuple):
    """A scene, who plans in it, and how it is carried out."""

    number: int
    target: str
    seed: int
    seen: str
    planner: str
    told_friction: float
    told_mass: bool
    conditions: tuple[tuple[float, float], ...]  # frictions and factors on the mass


def job_of(number: int, shapes: list[str]) -> Job:
    """Return scene `number`: four in a row are of one shape."""
    target = shapes[number // SCENES % len(shapes)]
    rng = np.random.default_rng([SEED, number, 1])
    seen, planner = _drawn(rng, {k: v[0] for k, v in _SEEN.items()}), _drawn(rng, _PLANNERS)
    told = _FRICTION if rng.random() < 0.5 else float(rng.uniform(*FRICTIONS))
    told_mass, seed = bool(rng.random() < 0.2), int(rng.integers(2**31))
    more = [
        (float(rng.uniform(*FRICTIONS)), float(np.exp(rng.uniform(*np.log(MASSES)))))
        for _ in range(CONDITIONS - 1)
    ]
    return Job(number, target, seed, seen, planner, told, told_mass, ((told, 1.0), *more))


def _drawn(rng: Generator, shares: Mapping[str, float]) -> str:
    return str(rng.choice(list(shares), p=list(shares.values())))


class Carrier(Agent):
    """Carries out a grasp as its file states it."""

    env_settings: ClassVar[Mapping[str, Any]] = {"obs_mode": "state", "control_mode": "joint_position"}

    def __init__(self, planned: Planned) -> None:
        """Take the grasp."""
        assert planned.script is not None
        self._script, self._grasp = planned.script, planned.grasp

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Begin."""
        self._motion = PickUp(self._script, self._grasp)

    def act(self, observation: Observation) -> NDArray[np.float32]:
        """Return the next set-points."""
        return self._motion.action(observation["joint_positions"])


def look(job: Job) -> tuple[Any, Scene, Array, float]:
    """Look at a scene; return who plans, what was seen, where the robot starts, and the object's mass, kg."""
    name = "bilevel" if job.planner == "later" else job.planner
    agent: Any = make_agent(name, request=GraspRequest(friction=job.told_friction))
    env = gym.make("DexGrasp/Lift-v2", objects=job.target, **agent.env_settings, **_SEEN[job.seen][1])
    observation, info = env.reset(seed=job.seed)
    mass = float(env.unwrapped.simulation.object.mass)  # type: ignore[attr-defined]
    env.close()
    planner = agent._planner
    scene = Scene.of_observation(observation, public_info(env, info))
    return planner, scene, start_of(observation, planner.cell.robot), mass


def plan(job: Job) -> tuple[PlanResult, float]:
    """Plan in a scene; return the plan, one grasp at most, and the object's mass, kg."""
    planner, scene, start, mass = look(job)
    count = _LATER if job.planner == "later" else None
    told = replace(planner.request, mass=mass if job.told_mass else None, count=count)
    result = plan_scene(planner.asking(told), scene, job.seed, start)
    if count and result.found:
        of_set = np.random.default_rng([SEED, job.number, 2])
        result.found = [result.found[int(of_set.integers(len(result.found)))]]
    return result, mass


def outcome_of(job: Job, planned: Planned, condition: tuple[float, float]) -> dict[str, Any]:
    """Carry a grasp out; return how it went, with and without pushes."""
    carrier = Carrier(planned)
    friction, factor = condition
    own = {"objects": job.target, "friction": friction, "mass": factor, **carrier.env_settings}
    row: dict[str, Any] = {"friction": friction, "mass_factor": factor}
    for protocol, extra in (("pushed@1", _PUSHED), ("lift", {})):
        env = gym.make("DexGrasp/Lift-v2", disable_env_checker=True, **own, **extra)
        outcome, _ = run_trial(env, carrier, TrialSeeds(job.seed, job.seed), name="carrier")
        env.close()
        row[protocol] = {"success": outcome.success, "reason": outcome.reason, "error": outcome.error}
        if outcome.success:  # what is held when pushed is held without
            row.setdefault("lift", row[protocol])
            break
    return row


def arrays_of(job: Job) -> Arrays:
    """Plan, carry out, and return all that is kept of a scene."""
    result, mass = plan(job)
    row: dict[str, Any] = {"job": job._asdict(), "mass": mass, "reason": result.reason, "rows": []}
    arrays: dict[str, Any] = {}
    if result.found:
        assert result.target is not None
        row["record"] = result.contents(job.target, job.planner)[0]
        row["rows"] = [outcome_of(job, result.found[0], condition) for condition in job.conditions]
        if result.target.spread is not None:
            arrays["spread_directions"], arrays["spread_errors"] = result.target.spread
    return arrays | {"row": bytes_of(json.dumps(row, allow_nan=False))}


def make(job: Job, folder: Path) -> None:
    """Make one file."""
    write_shard(path_of(folder, job), arrays_of(job), KEY)


def path_of(folder: Path, job: Job) -> Path:
    """Return where a scene is kept."""
    return folder / f"scene-{job.number:05d}.npz"


class Data(Script):
    """Makes the scenes that are not there yet.

    Attributes:
        outside: develop.json of `scripts/object_sets.py outside`.
    """

    out: Argument[Folder]
    outside: File
    scenes: Count = 6000
    backend: Backend = Backend()

    def run(self) -> int:
        self.out.mkdir(parents=True, exist_ok=True)
        # As many scenes of the one as of the other, however many there are.
        pairs = zip(resolve_targets([VARIED]), resolve_targets([str(self.outside)]), strict=False)
        shapes = [shape for pair in pairs for shape in pair]
        jobs, made = [job_of(k, shapes) for k in range(self.scenes)], partial(path_of, self.out)
        with progress_bar("scene", "scenes") as show:
            make_missing(
                partial(make, folder=self.out), jobs, lambda job: is_shard(made(job), KEY), self.backend, show
            )
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Data))
