"""Episodes that the probability of a grasp is fitted on: plans, good and deliberately worse, and how they held.

    python scripts/probability_data.py OUT --outside sets/outside/develop.json --scenes 3000
    python scripts/probability_data.py TEST --objects all20 --scenes 80          shapes to judge on

Scene k is always the same one: a shape of `varied-20000..21999` or of the 700 development shapes of `outside.py`, how
it is seen (four cameras, one, or miscalibrated ones), who plans (`bilevel`; one of twelve grasps of `plan --count 12`;
the ablations `cvae_kinematics` and `cvae`) and which friction and mass the planner is told, if any. What is planned is
carried out at four true frictions (0.3 to 0.9) and masses (0.5 to 3 times the object's own), as its file states it:
neither turned nor grasped again. An episode is `pushed@1` at that friction; where it fails after a push has begun, the
same grasp is lifted without pushes as well. OUT has a file a scene, with all that features are computed from; those
that are there are not made again.
"""

import json
import sys
from collections.abc import Mapping
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
from dexgrasp.evaluation.store import Outcome
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.motion.carrying import PickUp
from dexgrasp.planning.plan_scene import plan_scene, start_of
from dexgrasp.planning.result import Planned, PlanResult
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.registry import make_agent
from dexgrasp.runs.pool import Backend
from dexgrasp.runs.progress import progress_bar
from dexgrasp.runs.shards import bytes_of, is_shard, make_missing, write_shard
from dexgrasp_env.arrays import Array, Arrays
from dexgrasp_env.files import jsonable
from dexgrasp_env.objects.load import resolve_targets
from dexgrasp_env.objects.sets import is_set, set_member
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
_FALLEN = 0.05  # m above the table, below which what was lifted is lost
_LATE = 25  # control steps after the hand is up, by which what is not lifted never will be


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

    @property
    def steps(self) -> int:
        """Control steps until the hand is up, about."""
        return len(self._script.targets) - len(self._script.phases["hold"])

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Begin."""
        self._motion = PickUp(self._script, self._grasp)

    def act(self, observation: Observation) -> NDArray[np.float32]:
        """Return the next set-points."""
        return self._motion.action(observation["joint_positions"])


class Decided(gym.Wrapper[Any, Any, Any, Any]):
    """Ends an episode that is decided: what was dropped or left behind is not grasped again."""

    def __init__(self, env: gym.Env[Any, Any], up: int) -> None:
        """Take an environment, and the control steps until the hand is up."""
        super().__init__(env)
        self._up, self._step = up + _LATE, 0

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        """Count from nothing."""
        self._step = 0
        return super().reset(**kwargs)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step, and see whether there is more to come."""
        observation, reward, terminated, truncated, info = super().step(action)
        self._step += 1
        left = self._step > self._up and info["stage"] in ("untouched", "touched")
        fallen = info["stage"] == "dropped" and info["object_height"] < _FALLEN
        self.began = info["disturbance"] in ("running", "over")
        return observation, reward, terminated, truncated or left or fallen, info


def _env(job: Job, settings: Mapping[str, Any]) -> gym.Env[Any, Any]:
    target, own = job.target, {}
    if is_set(target):  # a mesh alone is kept from one environment to the next
        member = set_member(target)
        target, own = str(member.mesh), {"mesh_mass": member.mass, "mesh_scale": member.scale}
    return gym.make("DexGrasp/Lift-v2", objects=[target], disable_env_checker=True, **own, **settings)


def look(job: Job) -> tuple[Any, Scene, Array, float]:
    """Look at a scene; return who plans, what was seen, where the robot starts, and the object's mass, kg."""
    name = "bilevel" if job.planner == "later" else job.planner
    agent: Any = make_agent(name, settings=PlannerSettings.of(job.told_friction))
    env = _env(job, {**agent.env_settings, **_SEEN[job.seen][1]})
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
    result = plan_scene(planner, scene, job.seed, start, mass=mass if job.told_mass else None, count=count)
    if count and result.found:
        of_set = np.random.default_rng([SEED, job.number, 2])
        result.found = [result.found[int(of_set.integers(len(result.found)))]]
    return result, mass


def outcome_of(job: Job, planned: Planned, condition: tuple[float, float]) -> dict[str, Any]:
    """Carry a grasp out; return how it went, with and without pushes."""
    carrier = Carrier(planned)
    row: dict[str, Any] = {"friction": condition[0], "mass_factor": condition[1]}
    for protocol, extra in (("pushed@1", _PUSHED), ("lift", {})):
        env = Decided(
            _env(job, {**carrier.env_settings, **extra, "friction": condition[0], "mass": condition[1]}),
            carrier.steps,
        )
        outcome, _ = run_trial(env, carrier, TrialSeeds(job.seed, job.seed), name="carrier")
        row[protocol] = _short(outcome)
        env.close()
        if outcome.success or not env.began:  # without pushes it would have been the same
            row.setdefault("lift", row[protocol])
            break
    return row


def _short(outcome: Outcome) -> dict[str, Any]:
    kept = ("success", "reason", "stage", "steps", "slip", "tilt", "height", "error")
    return {name: jsonable(getattr(outcome, name)) for name in kept}


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
        outside: develop.json of scripts/outside.py.
        objects: other shapes, instead of those.
    """

    out: Argument[Folder]
    outside: File | None = None
    objects: tuple[str, ...] = ()
    scenes: Count = 6000
    backend: Backend = Backend()

    def run(self) -> int:
        self.out.mkdir(parents=True, exist_ok=True)
        if self.objects:
            shapes = resolve_targets(self.objects)
        else:  # as many scenes of the one as of the other, however many there are
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
