"""Benchmark of environment steps over raw physics: process CPU time, side by side in one run.

The raw loops start from the same states and replay the controls of the environment, so they make the same contacts;
both must end in the same states. They take turns every few steps, so that a busy machine slows both, and medians over
many rounds are reported.
"""

import itertools
import time
from dataclasses import dataclass
from functools import partial
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

from dexgrasp.motion.timing import ramp
from dexgrasp_env.arrays import AnyArray, Array, Fields
from dexgrasp_env.scene.constants import CONTROL_STEPS

_ID = "DexGrasp/Lift-v2"


@dataclass(frozen=True)
class RecordedRun:
    """Recorded run of an environment, single or vector.

    Attributes:
        env: the environment.
        seed: of its reset.
        actions: (T, n) or (T, N, n).
        models: of each of N simulations.
        states: of each at the start.
        controls: (T, N, 25, 23) rad, set-points of the physics steps.
    """

    env: Any
    seed: int
    actions: AnyArray
    models: list[mujoco.MjModel]
    states: list[Array]
    controls: Array


def run(quick: bool = False) -> Fields:
    """Return the ratio of raw over environment time by object and motion, and that of a vector environment.

    `random` moves all joints at random; `grasp` reaches for the object, closes the hand on it and lifts.

    Args:
        quick: fewer objects, steps and rounds.
    """
    objects = (
        ("sugar_box",)
        if quick
        else ("sugar_box", "tomato_soup_can", "mustard_bottle", "massage_ball", "castle")
    )
    rounds, steps = (3, 60) if quick else (15, 150)
    cases: Fields = {}
    for name in objects:
        env = gym.make(_ID, objects=name, control_mode="joint_delta", disable_env_checker=True)
        cases[f"{name}, random"] = _compare(_record(env, _random(steps)), rounds)
        if (grasp := _record_grasp(name, steps)) is not None:
            cases[f"{name}, grasp"] = _compare(grasp, rounds)
    ratios = [case["ratio"] for case in cases.values()]
    number = 16
    envs = gym.make_vec(_ID, num_envs=number, objects=list(objects), threads=1)
    many = _compare(_record(envs, _random(20 if quick else 40, number)), rounds)
    return {
        **cases,
        "all": {"ratio": np.median(ratios), "least_ratio": min(ratios)},
        f"vector, {number} environments, 1 thread": many,
    }


def _random(*shape: int) -> Array:
    """Return random actions (*shape, 23)."""
    return np.random.default_rng(0).uniform(-0.3, 0.3, (*shape, 23))


def _record_grasp(name: str, steps: int) -> RecordedRun | None:
    """Record the motion of the hard-coded agent; None where it finds no grasp."""
    from dexgrasp.agents.hardcoded import HardcodedAgent

    agent = HardcodedAgent()
    env = gym.make(_ID, objects=name, disable_env_checker=True, **agent.env_settings)
    for seed in range(8):
        observation, info = env.reset(seed=seed)
        agent.reset(observation, info)
        if agent.report.failure is None:
            actions = np.array([agent.act(observation) for _ in range(200 if steps >= 150 else 160)])
            return _record(env, actions, seed)
    return None


def _record(env: Any, actions: Array, seed: int = 0) -> RecordedRun:
    """Run an environment, single or vector, until an episode ends; record initial states and set-points."""
    env.reset(seed=seed)
    inner, many = env.unwrapped, actions.ndim == 3
    states = _states(env, env.num_envs if many else 1)
    models = [inner.simulation(i).model for i in range(len(states))] if many else [inner.model]
    targets, actions = [np.atleast_2d(inner.targets)], actions.astype(np.float32)
    for action in actions:
        terminated = env.step(action)[2]
        targets.append(np.atleast_2d(inner.targets))
        if not many and terminated:
            break
    controls = np.array([list(map(_ramp, a, b)) for a, b in itertools.pairwise(targets)])
    return RecordedRun(env, seed, actions[: len(controls)], models, states, controls)


def _states(env: Any, count: int) -> list[Array]:
    """Return the state of each simulation."""
    states = [env.get_state(i) for i in range(count)] if count > 1 else [env.unwrapped.get_state()]
    return [state.physics for state in states]


def _ramp(start: Array, end: Array) -> Array:
    """Return the set-points (25, 23) of the physics steps in a control step."""
    rows = ramp(start, end, CONTROL_STEPS)
    rows[-1] = end
    return rows


class _Loop:
    """Loop of physics alone over simulations, from the initial states of a recording."""

    def __init__(self, recording: RecordedRun) -> None:
        self.models = recording.models
        self.datas = [mujoco.MjData(model) for model in self.models]
        for model, data, state in zip(self.models, self.datas, recording.states, strict=True):
            mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)

    def run(self, controls: Array) -> None:
        """Advance with set-points (T, N, 25, 23) rad."""
        step = mujoco.mj_step
        for rows in controls:
            for model, data, own in zip(self.models, self.datas, rows, strict=True):
                ctrl = data.ctrl
                for row in own:
                    ctrl[:] = row
                    step(model, data)

    def check(self, env: Any) -> None:
        """Check that positions equal those of the environment.

        Raises:
            RuntimeError: if they do not.
        """
        for state, data in zip(_states(env, len(self.datas)), self.datas, strict=True):
            if not np.array_equal(data.qpos, state[1:31]):  # after the time
                raise RuntimeError("the raw loop and the environment do not end in the same state")


def _compare(recording: RecordedRun, rounds: int) -> dict[str, float]:
    times = np.array([_round(recording) for _ in range(rounds)])
    env, loop = np.median(times, axis=0)
    steps = len(recording.actions) * len(recording.models)
    return {
        "env_steps_per_second": steps / env,
        "raw_steps_per_second": steps / loop,
        "ratio": np.median(times[:, 1] / times[:, 0]),
    }


def _round(recording: RecordedRun) -> list[float]:
    """Return seconds of the environment and of physics alone over one run, in turns of a few control steps."""
    env, actions, raw = recording.env, recording.actions, _Loop(recording)
    env.reset(seed=recording.seed)
    sides = (partial(_run_env, env), actions), (raw.run, recording.controls)
    seconds = [0.0, 0.0]
    turn_steps = 5  # control steps
    for turn, first in enumerate(range(0, len(actions), turn_steps)):
        # Who comes first finds the caches cold: that alternates too.
        for which in (0, 1) if turn % 2 else (1, 0):
            run_part, rows = sides[which]
            start = time.process_time()
            run_part(rows[first : first + turn_steps])
            seconds[which] += time.process_time() - start
    raw.check(env)
    return seconds


def _run_env(env: Any, actions: AnyArray) -> None:
    for action in actions:
        env.step(action)
