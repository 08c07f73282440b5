"""Trainings that are stopped, and what they leave."""

import gymnasium as gym
import pytest

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.registry import make_agent


def goes_on_to_the_same_bits(make, folder):
    """Train in one go in `whole`, and stopped after an epoch in `parts`; return the first's state."""
    state = make(folder / "whole").run()
    with pytest.raises(KeyboardInterrupt):
        make(folder / "parts").run(interrupt)
    again = make(folder / "parts").run()
    assert again.epoch == again.epochs == state.epoch
    first, second = ((folder / name / "policy.safetensors").read_bytes() for name in ("whole", "parts"))
    assert first == second
    return state


def interrupt(state):
    """Interrupt a training after an epoch."""
    raise KeyboardInterrupt


def begun(folder, seed):
    """Return the agent of a training that has seen a scene, and what it saw."""
    agent = make_agent(folder)
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", **agent.env_settings)
    observation, info = env.reset(seed=seed)
    agent.reset(observation, info)
    assert env.action_space.contains(agent.act(observation))
    agent.reset(observation, info)
    return agent, observation
