"""Runner of trials, which reuses agents and environments."""

import warnings
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium as gym

from dexgrasp.agent import Env
from dexgrasp.evaluation.protocol import agent_settings, get_protocol, trial_seeds
from dexgrasp.evaluation.settings import EvaluationSettings, TrialSpec, hashes_by_name
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.evaluation.video import Video, VideoSettings
from dexgrasp.registry import is_server, make_agent, placing_agent
from dexgrasp.runs.reading import files_read
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import jsonable
from dexgrasp_env.objects.load import has_own_size
from dexgrasp_env.scene.constants import CONTROL_STEPS
from dexgrasp_env.tasks.constants import at_pace
from dexgrasp_env.tasks.settings import OF_CAMERAS


class TrialRunner:
    """Runs trials one after the other; every process has its own."""

    def __init__(self, settings: EvaluationSettings) -> None:
        self.settings = settings
        self._agents: dict[tuple[str, str], Any] = {}
        self._envs: dict[tuple[str, str, str, VideoSettings | None], Env] = {}

    def run(self, spec: TrialSpec) -> tuple[Fields, Fields | None]:
        """Run one trial; return its row of `trials.jsonl` and, for agents that certify one, the grasp.

        The row and the versions in run.json suffice to replay the trial.
        """
        agent, env = self.agent(spec), self._env(spec)
        seeds = spec.seeds or trial_seeds(self.settings.seed, spec.target, spec.trial)
        late = set[Path]()
        with Video(spec.video) if spec.video else nullcontext() as video, files_read(late):
            outcome, grasp = run_trial(env, agent, seeds, name=spec.agent, frames=video)
        row = {
            "protocol": spec.protocol, "agent": spec.agent, "object": spec.label, "trial": spec.trial,
            "scene_seed": seeds.scene, "agent_seed": seeds.agent, "env": self._env_arguments(spec),
        }  # fmt: skip
        # An agent of the user's reads when it acts; a served one does so elsewhere.
        if late and ":" in spec.agent and not is_server(spec.agent):
            row["files"] = hashes_by_name(sorted(late))
        return jsonable(row | asdict(outcome)), grasp

    def agent(self, spec: TrialSpec) -> Any:
        """Return an agent, made on first use.

        Raises:
            InputError: for an unknown name.
        """
        protocol = get_protocol(spec.protocol)
        key = spec.agent, protocol.env_id if protocol.places else ""
        if key not in self._agents:
            told = self.settings.checkpoint_settings(spec.agent)
            self._agents[key] = (
                placing_agent(spec.agent, key[1], **told) if key[1] else make_agent(spec.agent, **told)
            )
        return self._agents[key]

    def _env(self, spec: TrialSpec) -> Env:
        key = spec.protocol, spec.agent, spec.target, spec.film if spec.video else None
        envs = self._envs
        if key not in envs:
            while len(envs) >= 4:  # each holds a compiled scene
                envs.pop(next(iter(envs))).close()
            envs[key] = self.make_env(spec)
        return envs[key]

    def make_env(self, spec: TrialSpec) -> Env:
        """Return the protocol's environment with the agent's settings.

        Raises:
            InputError: if a setting is wrong.
        """
        render = spec.film.env_settings if spec.video else {}
        arguments = self._env_arguments(spec)
        seen = arguments.get("obs_mode", "state")  # a protocol's cameras are nothing to who does not look
        idle = {*(OF_CAMERAS if seen == "state" else ()), *(() if seen.endswith("pointcloud") else ("mask",))}
        needed = {key: value for key, value in arguments.items() if key not in idle}
        with warnings.catch_warnings():  # a protocol keeps the version that it was published with
            warnings.filterwarnings("ignore", ".* is out of date", DeprecationWarning)
            return gym.make(**needed, disable_env_checker=True, **render)

    def _env_arguments(self, spec: TrialSpec) -> Fields:
        """Return the keywords of `gym.make`: the scene of the protocol, and the settings of the agent."""
        env_id = get_protocol(spec.protocol).env_id
        scene, preset = self.settings.scene(spec.protocol), gym.spec(env_id)
        own = agent_settings(spec.agent, self.agent(spec), preset.kwargs)
        limit: Any = scene.get("max_episode_steps") or preset.max_episode_steps
        pace, hold = own.get("frame_skip", CONTROL_STEPS), own.get("hold", 1)
        if limit and (
            pace != CONTROL_STEPS or hold != 1
        ):  # as many seconds as the protocol has, at whatever pace
            scene |= {"max_episode_steps": -(-at_pace(limit, pace) // hold)}
        return {
            "id": env_id,
            "objects": [spec.target],
            **scene,
            **({"mesh_scale": 1.0, "mesh_mass": None} if has_own_size(spec.target) else {}),
            **own,
        }

    def close(self) -> None:
        """Close the environments, and the agents that can be closed."""
        for own in (*self._envs.values(), *self._agents.values()):
            if close := getattr(own, "close", None):
                close()
        self._envs.clear()
        self._agents.clear()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the settings only: another process makes its own agents and environments."""
        return _runner_elsewhere, (self.settings, self.settings.identity())


def _runner_elsewhere(settings: EvaluationSettings, identity: Fields) -> TrialRunner:
    """Return a runner in a worker process.

    Raises:
        InputError: where code or files there differ.
    """
    here = settings.identity(identity["files"])
    if other := [key for key, value in identity.items() if here[key] != value]:
        raise InputError(
            f"a worker has other {', '.join(other)} than the run began with: leave these alone while it runs; the "
            "nodes of a cluster need the same dexgrasp, and meshes and checkpoints at the same paths"
        )
    return TrialRunner(settings)
