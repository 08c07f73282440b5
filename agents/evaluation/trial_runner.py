"""A place to run trials at: makes agents and environments once and uses them again."""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym

import dexgrasp_env  # noqa: F401  (registers the environments)
from agents.evaluation.protocol import agent_settings, get_protocol, trial_seeds
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.trial import run_trial
from agents.evaluation.video import Video
from agents.registry import make_agent
from dexgrasp_env.files import jsonable

_MOST_ENVS = 4  # each holds a compiled scene


@dataclass(frozen=True)
class TrialSpec:
    """One trial to run.

    Attributes:
        agent: its name.
        target: the object, as `gym.make` takes it.
        label: the object, as people read it.
        trial: number from 0 on.
        video: file to record to, or None.
    """

    agent: str
    target: str
    label: str
    trial: int
    video: str | None = None


class TrialRunner:
    """Runs cells one after the other; every process has its own."""

    def __init__(self, settings: EvaluationSettings) -> None:
        self._settings = settings
        self._protocol = get_protocol(settings.protocol)
        self._agents: dict[str, Any] = {}
        self._envs: dict[tuple[str, str, bool], gym.Env[Any, Any]] = {}

    def run(self, cell: TrialSpec) -> dict[str, Any]:
        """Run one trial and return its line of `trials.jsonl`."""
        agent, env = self.agent(cell.agent), self._env(cell)
        seeds = trial_seeds(self._settings.seed, cell.target, cell.trial)
        video = Video(Path(cell.video)) if cell.video else None
        try:
            outcome = run_trial(env, agent, seeds, frames=video)
        finally:
            if video is not None:
                video.close()
        row = {"agent": cell.agent, "object": cell.label, "trial": cell.trial, "scene_seed": seeds.scene}
        row |= asdict(outcome) | ({"video": Path(cell.video).name} if cell.video else {})
        return {key: jsonable(value) for key, value in row.items()}

    def agent(self, name: str) -> Any:
        """Return an agent, made on first use.

        Raises:
            InputError: for an unknown name or settings that are not the agent's to choose.
        """
        if name not in self._agents:
            agent = make_agent(name)
            agent_settings(name, agent)
            self._agents[name] = agent
        return self._agents[name]

    def _env(self, cell: TrialSpec) -> gym.Env[Any, Any]:
        key = (cell.agent, cell.target, cell.video is not None)
        if key not in self._envs:
            while len(self._envs) >= _MOST_ENVS:
                self._envs.pop(next(iter(self._envs))).close()
            self._envs[key] = self.make_env(cell.agent, cell.target, recorded=cell.video is not None)
        return self._envs[key]

    def make_env(self, agent: str, target: str, *, recorded: bool = False) -> gym.Env[Any, Any]:
        """Return the protocol's environment with the agent's settings.

        Raises:
            InputError: if a setting is wrong.
        """
        chosen: Mapping[str, Any] = agent_settings(agent, self.agent(agent))
        render: dict[str, Any] = {"render_mode": "rgb_array"} if recorded else {}
        return gym.make(
            self._protocol.env_id, objects=(target,), disable_env_checker=True,
            **self._settings.scene(), **chosen, **render,
        )  # fmt: skip

    def close(self) -> None:
        """Free the environments."""
        for env in self._envs.values():
            env.close()
        self._envs.clear()


_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def thread_limits(workers: int) -> dict[str, str]:
    """Environment variables that give each of `workers` processes its share of the processors."""
    share = str(max(1, (os.cpu_count() or 1) // workers))
    return {name: os.environ.get(name, share) for name in _THREADS}
