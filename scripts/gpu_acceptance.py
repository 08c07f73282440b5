"""What physics on a GPU is worth on this machine: one table; kernels are compiled first, for 210 s on an H200.

    python scripts/gpu_acceptance.py [--device cuda:0] [--sizes 1024 4096 16384] [--out gpu.json]
    python scripts/gpu_acceptance.py --device cpu --sizes 4 8 --control-steps 5 --episodes 8 --random-steps 200

Environment steps a second over all20, given as numpy's arrays or as tensors, with and without its object of 33 parts;
how much of that is physics, resets and the rest; memory and cold start; episodes of the agent `rl` beside MuJoCo's on
the same scenes; random actions for long; and, with --tests, those of tests/test_warp*.py on the device, replays and
pushes among them. Every part prints its line as it ends; --out has all as JSON. It needs the repository, numpy's and
warp's wheels, and a driver; tensors a torch that was built for CUDA.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from soak import Soak, act

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp import make_agent
from dexgrasp.cli.benchmarks.timing import clocks
from dexgrasp.cli.command import File, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.statistics import mcnemar
from dexgrasp.learning.reinforcement.rl_policy import one
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import usable_cores
from dexgrasp_env.objects.load import resolve_targets
from dexgrasp_env.valid import Count, Positive

ID, FRAME_SKIP = "DexGrasp/Lift-v2", 25
ROOT = Path(__file__).resolve().parent.parent
Result = dict[str, Any]


def make(number: int, objects: list[str], device: str | None, **kwargs: Any) -> Any:
    """Make environments on a device, or MuJoCo's for None."""
    where = {"backend": "warp", "device": device} if device else {}
    return gym.make_vec(ID, num_envs=number, objects=objects, **where, **kwargs).unwrapped


def free_gb(device: str) -> float:
    """Return the free memory of a GPU, or 0 for the processor."""
    import warp as wp

    found = wp.get_device(device)
    return found.free_memory / 1e9 if found.is_cuda else 0.0


def throughput(number: int, objects: list[str], device: str, steps: int, tensors: bool) -> Result:
    """Step environments at random; episodes end at different times, as they do in a training."""
    before, start = free_gb(device), time.perf_counter()
    envs = make(number, objects, device, autoreset_mode="SameStep", tensors=tensors)
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    envs._episodes.records["elapsed"] = rng.integers(0, 300, number)
    actions: Any = rng.uniform(-1.0, 1.0, (steps + 2, *envs.action_space.shape)).astype(np.float32)
    if tensors:
        import torch

        actions = torch.as_tensor(actions, device=device)
    envs.step(actions[0])
    cold = time.perf_counter() - start
    envs.step(actions[1])
    start = time.perf_counter()
    with clocks((envs._physics, "step"), (envs, "_reset_one")) as seconds:
        for row in actions[2:]:
            envs.step(row)
    whole = time.perf_counter() - start
    physics, resets = seconds["step"], seconds["_reset_one"]
    used = before - free_gb(device)
    envs.close()
    return {
        "environments": number, "steps_per_second": number * steps / whole,
        "physics_steps_per_second": FRAME_SKIP * number * steps / sum(physics),
        "first_step_seconds": cold, "memory_gb": used, "physics_share": sum(physics) / whole,
        "reset_share": sum(resets) / whole, "resets": len(resets),
        "host_share": 1.0 - (sum(physics) + sum(resets)) / whole,
    }  # fmt: skip


def episodes(number: int, objects: list[str], device: str | None) -> np.ndarray:
    """Have `rl` act in as many scenes, one an environment; return which it solved (N,)."""
    agent: Any = make_agent("rl")
    envs = make(number, objects, device, autoreset_mode="Disabled", **agent.env_settings)
    seen, _ = envs.reset(seed=1000)
    cell, policy = envs.settings.cell, agent._policy

    solved, over = np.zeros(number, bool), np.zeros(number, bool)
    runs = [policy.begin(one(seen, i), cell) for i in range(number)]
    for _ in range(300):
        actions = np.stack([run.action(one(seen, i)) for i, run in enumerate(runs)])
        seen, _, terminated, truncated, infos = envs.step(actions)
        solved |= infos["is_success"] & ~over
        over |= terminated | truncated
        if (solved | over).all():
            break
        if terminated.any():  # they are to stand still, not to hold the others up
            envs.reset(options={"reset_mask": terminated})
    envs.close()
    return solved


def closed_loop(number: int, objects: list[str], device: str) -> Result:
    """Compare the agent's successes here and in MuJoCo (b), on the same scenes."""
    ours, theirs = episodes(number, objects, device), episodes(number, objects, None)
    compared = mcnemar(zip(ours, theirs, strict=True))
    return {"episodes": number, "rate": ours.mean(), "rate_mujoco": theirs.mean(), **compared}


def random_steps(total: int, number: int, objects: list[str], device: str, seconds: float) -> Result:
    """Take random actions until there are as many environment steps, or time is up; count how episodes end."""
    envs, rng, soak = make(number, objects, device), np.random.default_rng(2), Soak()
    envs.reset(seed=2)
    start = time.perf_counter()
    while soak.steps < total and time.perf_counter() - start < seconds:
        act(envs, 20, rng, soak)
    envs.close()
    found = {"steps": soak.steps, "not_finite": soak.not_finite}
    return found | {"endings": dict(soak.endings), "warnings": dict(soak.warnings)}


def tested(device: str) -> Result:
    """Run the tests that hold the physics to MuJoCo's, on the device."""
    command = [
        sys.executable,
        *["-m", "pytest", "-m", "warp", "tests/test_warp.py", "tests/test_warp_device.py"],
    ]
    done = subprocess.run(
        command, cwd=ROOT, env=os.environ | {"DEXGRASP_WARP_DEVICE": device}, capture_output=True, text=True
    )
    return {"passed": done.returncode == 0, "last_line": done.stdout.strip().splitlines()[-1:]}


def shown(value: Any) -> str:
    """Return a value as a line of the table has it."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"


class Acceptance(Script):
    """Measures one part after the other.

    Attributes:
        control_steps: of every measurement of speed.
        episodes: of rl, here and in MuJoCo.
        random_seconds: after which random actions end.
        tests: tests/test_warp*.py on the device as well.
    """

    device: str = "cuda:0"
    sizes: tuple[Count, ...] = (1024, 4096, 16384)
    control_steps: Count = 40
    episodes: Count = 1000
    random_steps: Count = 10_000_000
    random_seconds: Positive = 120.0
    tests: bool = False
    out: File | None = None

    def parts(self) -> dict[str, Callable[[], Result]]:
        """Return what is measured, by name."""
        objects, device = resolve_targets(["all20"]), self.device
        plain = [name for name in objects if name != "massage_ball"]
        parts: dict[str, Callable[[], Result]] = {
            f"speed, {len(own)} objects, {kind}, {n}": partial(
                throughput, n, own, device, self.control_steps, kind == "tensors"
            )
            for own, kind in ((objects, "arrays"), (objects, "tensors"), (plain, "tensors"))
            for n in self.sizes
        }
        parts["rl"] = partial(closed_loop, self.episodes, objects, device)
        middle = self.sizes[len(self.sizes) // 2]
        parts["random actions"] = partial(
            random_steps, self.random_steps, middle, objects, device, self.random_seconds
        )
        return parts | ({"tests": partial(tested, device)} if self.tests else {})

    def run(self) -> int:
        results: Result = {"device": self.device, "cores": usable_cores(), "load": os.getloadavg()[0]}
        began = time.perf_counter()
        for name, measure in self.parts().items():
            start = time.perf_counter()
            try:
                results[name] = measure()
            except InputError as refusal:  # a torch without CUDA, say
                results[name] = {"refused": str(refusal)}
            results[name]["seconds"] = time.perf_counter() - start
            print(f"{name}: " + ", ".join(f"{k} {shown(v)}" for k, v in results[name].items()), flush=True)
            if self.out:
                self.out.write_text(json.dumps(results, indent=1, default=float))
        print(f"{time.perf_counter() - began:.0f} s in all")
        return 0


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as cache:
        os.environ.setdefault("WARP_CACHE_PATH", cache)  # a cold start is one
        sys.exit(run_script(Acceptance))
