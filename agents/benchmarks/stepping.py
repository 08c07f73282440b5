"""What the environment costs over raw physics: steps a second, side by side in one run.

The raw loop starts from the same state and replays the very controls of the environment, so it makes the same
contacts; that both end in the same state is checked. They take turns, so that a busy machine slows both.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import rotate
from dexgrasp_env.scene.constants import CONTROL_STEPS
from dexgrasp_env.tasks.simulation import Simulation

_TURN = 5  # control steps
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@dataclass(frozen=True)
class Recording:
    """Actions of one episode with the start state and the controls that they led to."""

    env: gym.Env[Any, Any]
    seed: int
    actions: Array  # (T, 23)
    state: Array
    controls: Array  # (T * 25, 23)
    contacts: float  # mean number of contacts


def run(quick: bool = False) -> dict[str, Any]:
    """Return steps a second of the environment and of the raw loop, and their ratio, by object and motion.

    `random` moves all joints at random; `grasp` reaches for the object, closes the hand on it and lifts.

    Args:
        quick: fewer objects, steps and alternations.
    """
    objects = (
        ("sugar_box", "massage_ball")
        if quick
        else ("sugar_box", "tomato_soup_can", "mustard_bottle", "massage_ball", "castle")
    )
    rounds = 5 if quick else 11
    cases: dict[str, Any] = {}
    for name in objects:
        for motion, record in (("random", _record_random), ("grasp", _record_grasp)):
            recording = record(name, 60 if quick else 150)
            if recording is not None:
                cases[f"{name}, {motion}"] = _compare(recording, rounds)
    ratios = [case["ratio"] for case in cases.values()]
    return {**cases, "all": {"ratio": float(np.median(ratios)), "least_ratio": min(ratios)}}


def _record_random(name: str, steps: int) -> Recording:
    env = gym.make("DexGrasp/Lift-v1", objects=name, control_mode="joint_delta")
    return _record(env, np.random.default_rng(0).uniform(-0.3, 0.3, (steps, 23)))


def _record_grasp(name: str, steps: int) -> Recording | None:
    """The hard-coded agent's motion, planned from the true surface; None where it finds none."""
    from agents.policies.hardcoded import HardcodedAgent

    env = gym.make("DexGrasp/Lift-v1", objects=name, control_mode="joint_position")
    agent = HardcodedAgent()
    for seed in range(8):
        observation, _ = env.reset(seed=seed)
        simulation: Simulation = env.unwrapped.simulation  # type: ignore[attr-defined]
        points = _surface(simulation)
        cloud = {"cloud": points, "cloud_mask": np.ones(len(points), bool)}
        agent.reset({**observation, **cloud}, {"action_space": env.action_space})
        if agent.report.failure is None:
            actions = np.array([agent.act({}) for _ in range(200)])
            return _record(env, actions[: 200 if steps >= 150 else 160], seed)
    return None


def _surface(simulation: Simulation) -> Array:
    mesh, pose = simulation.object.mesh, simulation.data.qpos[23:30]
    points, _ = mesh.sample(1024, return_index=True, seed=0)
    return rotate(pose[3:], np.asarray(points)) + pose[:3]


def _record(env: gym.Env[Any, Any], actions: Array, seed: int = 0) -> Recording:
    env.reset(seed=seed)
    simulation: Simulation = env.unwrapped.simulation  # type: ignore[attr-defined]
    state = np.zeros(mujoco.mj_stateSize(simulation.model, _STATE))
    mujoco.mj_getState(simulation.model, simulation.data, state, _STATE)
    controls, contacts, targets = [], [], env.unwrapped.targets  # type: ignore[attr-defined]
    for count, action in enumerate(actions):
        _, _, terminated, _, _ = env.step(action.astype(np.float32))
        start, targets = targets, env.unwrapped.targets  # type: ignore[attr-defined]
        controls.append(_ramp(start, targets))
        contacts.append(simulation.data.ncon)
        if terminated:
            actions = actions[: count + 1]
            break
    return Recording(
        env, seed, actions.astype(np.float32), state, np.concatenate(controls), float(np.mean(contacts))
    )


def _ramp(start: Array, end: Array) -> Array:
    """Return the set-points (25, 23) of the physics steps in a control step."""
    rows = start + np.arange(1, CONTROL_STEPS + 1)[:, None] / CONTROL_STEPS * (end - start)
    rows[-1] = end
    return rows


def _compare(recording: Recording, rounds: int) -> dict[str, float]:
    times = np.array([_round(recording) for _ in range(rounds)])
    env, raw = np.median(times, axis=0)
    steps = len(recording.actions)
    return {
        "env_steps_per_second": steps / float(env),
        "raw_steps_per_second": steps / float(raw),
        "ratio": float(np.median(times[:, 1] / times[:, 0])),
        "contacts": recording.contacts,
    }


def _round(recording: Recording) -> tuple[float, float]:
    """Seconds of the environment and of the raw loop over one episode, taking turns every few control steps."""
    env, actions, controls = recording.env, recording.actions, recording.controls
    env.reset(seed=recording.seed)
    simulation: Simulation = env.unwrapped.simulation  # type: ignore[attr-defined]
    model, data = simulation.model, mujoco.MjData(simulation.model)
    mujoco.mj_setState(model, data, recording.state, _STATE)
    seconds = [0.0, 0.0]
    for first in range(0, len(actions), _TURN):
        last = min(first + _TURN, len(actions))
        turns: list[tuple[int, Callable[..., None], tuple[Any, ...]]] = [
            (0, _run_env, (env, actions[first:last])),
            (1, _run_raw, (model, data, controls[first * CONTROL_STEPS : last * CONTROL_STEPS])),
        ]
        # Who comes first finds the caches cold: that alternates too.
        for which, run_part, arguments in turns if first // _TURN % 2 else reversed(turns):
            seconds[which] += _seconds(run_part, *arguments)
    if not np.array_equal(data.qpos, simulation.data.qpos):
        raise RuntimeError("the raw loop and the environment do not end in the same state")
    return seconds[0], seconds[1]


def _seconds(function: Callable[..., None], *arguments: Any) -> float:
    start = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - start


def _run_env(env: gym.Env[Any, Any], actions: Array) -> None:
    for action in actions:
        env.step(action)


def _run_raw(model: mujoco.MjModel, data: mujoco.MjData, controls: Array) -> None:
    step, ctrl = mujoco.mj_step, data.ctrl
    for row in controls:
        ctrl[:] = row
        step(model, data)
