"""Random actions on every object, for long, in one process: nothing may raise, go wrong or grow.

    python scripts/soak.py [--steps 12000] [--objects all20 ycb6] [--vector 16]

A round is every environment once. Exits with 1 if a number was not finite, or if the process held 50 MB more after the
last round than in the middle, when caches are full.
"""

import ctypes
import os
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.cli.command import Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Count, Natural

GROWTH_MB = 50.0
MODES = ("joint_position", "joint_delta", "ee_delta")
RANDOMISATION = {
    "mass": (0.5, 2.0), "friction": (0.3, 1.2), "size": (0.8, 1.2), "gain": (0.7, 1.3), "latency": (0.0, 0.05),
    "joint_noise": (0.0, 0.01),
}  # fmt: skip


@dataclass
class Soak:
    """Result of a run.

    Attributes:
        steps: of all environments.
        not_finite: how many environments had a number gone wrong, once a step.
        memory_mb: resident after each round.
    """

    steps: int = 0
    not_finite: int = 0
    endings: Counter[str] = field(default_factory=Counter)
    warnings: Counter[str] = field(default_factory=Counter)
    memory_mb: list[float] = field(default_factory=list)

    @property
    def growth_mb(self) -> float:
        """Memory gained from the middle round to the last; nan of fewer than two."""
        rounds = self.memory_mb
        return rounds[-1] - rounds[(len(rounds) - 1) // 2] if len(rounds) > 1 else float("nan")

    @property
    def is_clean(self) -> bool:
        """No number gone wrong, and memory flat."""
        return self.not_finite == 0 and not self.growth_mb > GROWTH_MB

    def end_round(self) -> None:
        """Take down the memory that the process holds."""
        self.memory_mb.append(memory_mb())
        print(f"{self.steps} steps, {self.memory_mb[-1]:.0f} MB", file=sys.stderr)


def memory_mb() -> float:
    """Resident memory of this process, without what the allocator keeps though it is free."""
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def run(
    steps: int, objects: list[str], number: int, *, seed: int = 0, episode: int = 60, ids: Sequence[str] = ()
) -> Soak:
    """Step the native vector environments of the ids (or all), control and observation modes in turns."""
    rng = np.random.default_rng(seed)
    ids = ids or sorted(name for name in gym.registry if name.startswith("DexGrasp/"))
    kinds: list[tuple[str, str, dict[str, Any]]] = [(name, mode, {}) for mode in MODES for name in ids]
    kinds += [("DexGrasp/Lift-v2", MODES[0], {"obs_mode": mode}) for mode in ("depth", "pointcloud")]
    soak = Soak()
    while soak.steps < steps:
        for name, mode, more in kinds:
            seen = {"observe": "reset"} if more or "View" in name else {}
            envs = gym.make_vec(
                name, num_envs=number, control_mode=mode, objects=objects, max_episode_steps=episode,
                randomisation=RANDOMISATION, friction=None, **more, **seen,  # presets state one, here it is drawn
            )  # fmt: skip
            _reset(envs, rng)
            act(envs, 2 * episode + 2, rng, soak)
            envs.close()
        soak.end_round()
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
        over = np.flatnonzero(terminated | truncated)
        soak.endings.update((infos["failure"][i] or infos["stage"][i]) for i in over)
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
        steps: at least, in whole rounds.
        vector: environments beside each other.
    """

    steps: Count = 12_000
    objects: tuple[str, ...] = ("all20", "ycb6")
    seed: Natural = 0
    vector: Count = 1

    def run(self) -> int:
        soak = run(self.steps, list(self.objects), self.vector, seed=self.seed)
        print(f"{soak.steps} steps, {soak.endings.total()} ends {dict(soak.endings)}")
        print(f"numbers gone wrong {soak.not_finite}; warnings {dict(soak.warnings) or 'none'}")
        print(f"memory {soak.growth_mb:+.1f} MB from the middle round to the last")
        print("clean" if soak.is_clean else "NOT CLEAN")
        return int(not soak.is_clean)


if __name__ == "__main__":
    sys.exit(run_script(Soaking))
