"""Random actions or plans on every object, for long, in one process: nothing may raise, go wrong, grow or slow down.

    python scripts/soak.py [--steps 12000] [--objects all20 ycb6] [--vector 16]
    python scripts/soak.py --plans 10000 [--robots default FILE]

Exits with 1 if a number was not finite, if the same environments or plans held 50 MB more in the last turn through all
of them than in the turn in which the first thousand episodes or plans were over, or if the last tenth of the plans took
5 % longer than the first. Memory is judged from two turns on: fewer do not tell caches that fill from leaks.
"""

import ctypes
import os
import resource
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import cycle, islice, product
from pathlib import Path
from time import process_time
from typing import Any

import gymnasium as gym
import numpy as np

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.cli.command import Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import resolve_targets
from dexgrasp_env.valid import Count, Natural

GROWTH_MB = 50.0
SETTLED = 1000  # episodes or plans, after which caches are full
SLOWER = 1.05
MODES = ("joint_position", "joint_delta", "ee_delta")
RANDOMISATION = {
    "mass": (0.5, 2.0), "friction": (0.3, 1.2), "size": (0.8, 1.2), "gain": (0.7, 1.3), "latency": (0.0, 0.05),
    "joint_noise": (0.0, 0.01),
}  # fmt: skip


@dataclass
class Soak:
    """Result of a run.

    Attributes:
        again: how many environments or plans there are before the same ones come again.
        steps: or plans.
        not_finite: how many environments had a number gone wrong, once a step.
        memory_mb: (environments or plans,) resident after each, in their order.
        settled: how many of these there were when the first `SETTLED` episodes or plans were over.
        seconds: (plans,) of processor time, in their order.
    """

    again: int = 1
    steps: int = 0
    episodes: int = 0
    not_finite: int = 0
    endings: Counter[str] = field(default_factory=Counter)
    warnings: Counter[str] = field(default_factory=Counter)
    memory_mb: list[float] = field(default_factory=list)
    settled: int = 0
    seconds: list[float] = field(default_factory=list)

    @property
    def growth_mb(self) -> float:
        """Median of what the same ones gained from when they had settled to the last turn; nan of one turn."""
        turns = self._turns(self.memory_mb)
        first = min(self.settled // self.again, len(turns) - 2)
        return float(np.median(turns[-1] - turns[first])) if len(turns) > 1 else float("nan")

    @property
    def slowdown(self) -> float:
        """Median share by which plans of the last tenth took longer than the same ones of the first."""
        turns = self._turns(self.seconds)
        tenth = max(1, len(turns) // 10)
        return float(np.median(turns[-tenth:] / turns[:tenth])) if len(turns) > 1 else float("nan")

    @property
    def is_clean(self) -> bool:
        """No number gone wrong, memory flat, and no slower at the end."""
        return self.not_finite == 0 and not self.growth_mb > GROWTH_MB and not self.slowdown > SLOWER

    def note_memory(self, over: int) -> None:
        """Take down the memory that the process holds, where so many episodes or plans are over."""
        self.memory_mb.append(memory_mb())
        if over < SETTLED:
            self.settled = len(self.memory_mb)
        print(f"{self.steps} steps, {self.memory_mb[-1]:.0f} MB", file=sys.stderr)

    def _turns(self, values: list[float]) -> Array:
        """(turns, again): the whole ones."""
        whole = len(values) // self.again * self.again
        return np.array(values[:whole]).reshape(-1, self.again)


def memory_mb() -> float:
    """Resident memory of this process, without what the allocator keeps though it is free."""
    try:
        ctypes.CDLL("libc.so.6").malloc_trim(0)
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    except (OSError, AttributeError):  # not Linux with glibc: the peak will do
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run(
    steps: int, objects: list[str], number: int, *, seed: int = 0, episode: int = 60, ids: Sequence[str] = ()
) -> Soak:
    """Step the native vector environments of the ids (or all), control and observation modes in turns."""
    rng = np.random.default_rng(seed)
    ids = ids or sorted(name for name in gym.registry if name.startswith("DexGrasp/"))
    kinds: list[tuple[str, str, dict[str, Any]]] = [(name, mode, {}) for mode in MODES for name in ids]
    kinds += [("DexGrasp/Lift-v2", MODES[0], {"obs_mode": mode}) for mode in ("depth", "pointcloud")]
    soak = Soak(len(kinds))
    for name, mode, more in cycle(kinds):
        if more or "View" in name:
            more = more | {"observe": "reset"}
        more = more | {
            "objects": objects,
            "max_episode_steps": episode,
            "randomisation": RANDOMISATION,
            "friction": None,  # which presets state, and is drawn here
        }
        envs = gym.make_vec(name, num_envs=number, control_mode=mode, **more)
        _reset(envs, rng)
        most = 2 * episode + 2  # and a step for each reset
        act(envs, min(most, -(-(steps - soak.steps) // number)), rng, soak)
        envs.close()
        soak.note_memory(soak.episodes)
        if soak.steps >= steps:
            break
    return soak


def run_plans(plans: int, objects: list[str], robots: list[str], *, scenes: int = 2) -> Soak:
    """Look and plan, with objects and robots in turns; every object in `scenes` scenes, then the same again."""
    from dexgrasp.planning.scene_setup import look_at
    from dexgrasp.registry import make_agent

    agents = {robot: make_agent("bilevel") for robot in robots}
    turns = list(product(range(scenes), resolve_targets(objects), robots))
    soak = Soak(len(turns))
    for seed, name, robot in islice(cycle(turns), plans):
        look = look_at(name, agents[robot], seed, robot=None if robot == "default" else robot)
        began = process_time()
        found = agents[robot].plan(look.observation, look.info)  # type: ignore[attr-defined]
        soak.seconds.append(process_time() - began)
        soak.steps += 1
        soak.endings["planned" if found.success else str(found.shortfall)] += 1
        soak.note_memory(soak.steps)
    return soak


def act(envs: Any, steps: int, rng: np.random.Generator, soak: Soak) -> None:
    """Take random actions in running environments, and note what comes up."""
    centre = rng.uniform(-1, 1, envs.action_space.shape)
    for _ in range(steps):
        action = np.clip(centre + rng.normal(0, 0.5, centre.shape), -1, 1)
        observation, rewards, terminated, truncated, infos = envs.step(action)
        soak.steps += envs.num_envs
        finite = np.isfinite(rewards)
        for values in observation.values():
            finite &= np.isfinite(values).reshape(envs.num_envs, -1).all(axis=1)
        soak.not_finite += int((~finite & (infos["failure"] != "simulation_diverged")).sum())
        over = terminated | truncated
        soak.episodes += int(over.sum())
        soak.endings.update((infos["failure"][i] or infos["stage"][i]) for i in np.flatnonzero(over))
        soak.warnings.update(" ".join(infos["mujoco_warnings"]).split())


def _reset(envs: Any, rng: np.random.Generator) -> None:
    """Drop the objects on the hands, or leave them on the table, where random actions hardly ever find them."""
    observation, _ = envs.reset(seed=int(rng.integers(2**31)))
    quat = rng.normal(size=4)
    if "palm_pose" in observation and rng.random() < 0.7:
        place = observation["palm_pose"][0, :3] + rng.uniform([-0.05, -0.08, 0.12], [0.15, 0.08, 0.30])
        with suppress(InputError):  # the arm is in the way
            envs.reset(options={"object_pose": np.concatenate([place, quat / np.linalg.norm(quat)])})
            return
        envs.reset()


class Soaking(Script):
    """Runs the soak and reports.

    Attributes:
        vector: environments beside each other.
        plans: plans instead of steps.
        robots: of the plans, in turns.
    """

    steps: Count = 12_000
    objects: tuple[str, ...] = ("all20", "ycb6")
    seed: Natural = 0
    vector: Count = 1
    plans: Count | None = None
    robots: tuple[str, ...] = ("default",)

    def run(self) -> int:
        if self.plans:
            soak = run_plans(self.plans, list(self.objects), list(self.robots))
        else:
            soak = run(self.steps, list(self.objects), self.vector, seed=self.seed)
        print(f"{soak.steps} steps, {soak.episodes} episodes; endings {dict(soak.endings)}")
        print(f"numbers gone wrong {soak.not_finite}; warnings {dict(soak.warnings) or 'none'}")
        print(f"memory {soak.growth_mb:+.1f} MB, time x {soak.slowdown:.3f}, of the same from first to last")
        print("clean" if soak.is_clean else "NOT CLEAN")
        return int(not soak.is_clean)


if __name__ == "__main__":
    sys.exit(run_script(Soaking))
