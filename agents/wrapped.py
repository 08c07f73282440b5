"""Player of a policy behind the wrappers that it was trained in.

Wrappers call an environment for a step; an agent is asked for an action. A thread of the policy's own turns one into
the other, so that wrappers keep their state, act as often as they like, and see no more of the simulation than agents.
"""

import importlib
import shlex
import threading
from queue import SimpleQueue
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec

from dexgrasp.agent import Observation
from dexgrasp.learning.reinforcement.env_record import EnvRecord, WrapperRecord, array_of
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError, first_line
from dexgrasp_env.extras import from_extra

with from_extra():
    from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecEnvWrapper

_KNOWN = (
    "gymnasium.wrappers.",
    "stable_baselines3.common.",
    "sb3_contrib.common.",
    "dexgrasp.",
    "dexgrasp_env.",
)
"""Modules of wrappers that a record may name; others are code that the user has to name."""


class Relay(gym.Env[Any, Any]):
    """Stand-in for the environment below a policy's wrappers.

    Attributes:
        first: observation of the next reset.
        exchange: gives an action away, and returns the observation that comes of it.
    """

    first: Observation
    exchange: Any

    def __init__(self, observation_space: Any, action_space: Any, record: EnvRecord) -> None:
        self.observation_space, self.action_space = observation_space, action_space
        self.spec = EnvSpec(record.id or "DexGrasp/Lift-v2", max_episode_steps=record.max_episode_steps)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, Fields]:
        """Return the first observation."""
        super().reset(seed=seed)
        return self.first, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, Fields]:
        """Give an action away; no episode ends here."""
        return self.exchange(action), 0.0, False, False, {}


def wrapped(relay: Relay, record: EnvRecord, own: frozenset[str]) -> VecEnv:
    """Return the relay in a policy's wrappers.

    Args:
        relay: innermost.
        record: names the wrappers.
        own: names of the user's own among them, which may be imported.

    Raises:
        InputError: for a wrapper that cannot be made here.
    """
    _refuse_unnamed(record, own)
    env: Any = relay
    for each in record.wrappers:
        env = _made(each, env)
    envs: Any = DummyVecEnv([lambda: env])
    for each in record.vec_wrappers:
        envs = _made(each, envs)
    return envs


def _refuse_unnamed(record: EnvRecord, own: frozenset[str]) -> None:
    """Refuse code that the user has not named, and wrappers whose arguments nobody knows.

    Raises:
        InputError: with the option that names them.
    """
    unnamed = [
        each
        for each in (*record.wrappers, *record.vec_wrappers)
        if each.kwargs is None or not (each.name.startswith(_KNOWN) or each.name in own)
    ]
    if unnamed:
        words = " ".join(shlex.quote(_written(each)) for each in record.wrappers)
        raise InputError(
            f"the policy was trained in {unnamed[0].short}, a wrapper of its author's, whose code runs if you name all "
            f"of them (what is ... was not recorded): --wrappers {words}"
        )


def _written(record: WrapperRecord) -> str:
    """Return a wrapper as `--wrappers` takes it."""
    known = record.kwargs if record.kwargs is not None else {"": ...}
    stated = ", ".join("..." if value is ... else f"{key}={value!r}" for key, value in known.items())
    return f"{record.name.replace(':', '.')}({stated})"


def _made(record: WrapperRecord, env: Any) -> Any:
    module, _, name = record.name.partition(":")
    try:
        kind = getattr(importlib.import_module(module), name)
        if not issubclass(kind, gym.Wrapper | VecEnvWrapper):
            raise TypeError("it is no wrapper")
        made: Any = kind(env, **{key: array_of(value) for key, value in (record.kwargs or {}).items()})
        if record.state:
            _restore(made, record)
    except (Exception, SystemExit) as error:  # of whatever kind the wrapper's author chose
        raise InputError(f"wrapper {record.name} cannot be made: {first_line(error)[:160]}") from error
    return made


def _restore(wrapper: Any, record: WrapperRecord) -> None:
    """Set what was counted, and count no more."""
    for key, own in record.state.items():
        counted = wrapper.obs_rms[key] if key else wrapper.obs_rms
        counted.mean, counted.var = (
            np.array(own[part], dtype=counted.mean.dtype).reshape(counted.mean.shape)
            for part in ("mean", "var")
        )
    for name in ("training", "update_running_mean"):
        if hasattr(wrapper, name):
            setattr(wrapper, name, False)


class _OverError(BaseException):
    """End of an episode, for the thread that waits in it."""


class Player:
    """A policy in one episode."""

    def __init__(self, policy: Any, envs: VecEnv, relay: Relay, first: Observation) -> None:
        self._policy, self._envs = policy, envs
        relay.first, relay.exchange = first, self._exchange
        self._actions, self._observations = SimpleQueue[Any](), SimpleQueue[Any]()
        self._thread = threading.Thread(target=self._play, daemon=True)

    def action(self, observation: Observation) -> Any:
        """Return the next action; the first is the answer to the observation that the player was made with.

        Raises:
            Exception: whatever the wrappers raise.
        """
        if self._thread.ident is None:
            self._thread.start()
        else:
            self._observations.put(observation)
        said = self._actions.get()
        if isinstance(said, Exception):
            self._actions.put(said)  # and to whoever asks again
            raise said
        return said

    def end(self) -> None:
        """End the episode."""
        if self._thread.ident is not None:
            self._observations.put(None)
            self._thread.join()

    def _exchange(self, action: Any) -> Observation:
        self._actions.put(np.array(action))
        observation = self._observations.get()
        if observation is None:
            raise _OverError
        return observation

    def _play(self) -> None:
        starts, state = np.ones(1, dtype=bool), None
        try:
            seen: Any = self._envs.reset()
            while True:
                actions, state = self._policy.predict(
                    seen, state=state, episode_start=starts, deterministic=True
                )
                seen, *_ = self._envs.step(actions)
                starts[:] = False
        except _OverError:
            pass
        except Exception as error:
            self._actions.put(error)
