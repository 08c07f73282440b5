"""Player of a policy behind the wrappers that it was trained in.

Wrappers call an environment for a step; an agent is asked for an action. A thread of the policy's own turns one into
the other, so that wrappers keep their state, act as often as they like, and see no more of the simulation than agents.
"""

import pkgutil
import shlex
import threading
from functools import reduce
from queue import SimpleQueue
from typing import Any, cast

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
    """Stand-in for the environment below a policy's wrappers: a thread of the policy's steps it."""

    _thread: threading.Thread | None = None
    _seen: SimpleQueue[Any]

    def __init__(self, observation_space: Any, action_space: Any, record: EnvRecord) -> None:
        self.observation_space, self.action_space = observation_space, action_space
        self.spec = EnvSpec("Relay", max_episode_steps=record.max_episode_steps)

    def begin(self, policy: Any, envs: VecEnv) -> None:
        """Begin an episode of a policy behind its wrappers; the last one ends."""
        if self._thread:
            self._seen.put(None)
            self._thread.join()
        self._actions, self._seen = SimpleQueue[Any](), SimpleQueue()
        self._thread = threading.Thread(target=self._play, args=(policy, envs), daemon=True)
        self._thread.start()

    def action(self, observation: Observation) -> Any:
        """Return the action that answers an observation.

        Raises:
            Exception: whatever the wrappers raise.
        """
        self._seen.put(observation)
        said = self._actions.get()
        if isinstance(said, Exception):
            self._actions.put(said)  # and to whoever asks again
            raise said
        return said

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, Fields]:
        """Return the first observation."""
        super().reset(seed=seed)
        return self._next(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, Fields]:
        """Give an action away; no episode ends here."""
        self._actions.put(np.array(action))
        return self._next(), 0.0, False, False, {}

    def _next(self) -> Observation:
        if (observation := self._seen.get()) is None:
            raise SystemExit  # of the thread, which ends without a word
        return observation

    def _play(self, policy: Any, envs: VecEnv) -> None:
        starts, state = np.ones(1, dtype=bool), None
        try:
            seen: Any = envs.reset()
            while True:
                actions, state = policy.predict(seen, state=state, episode_start=starts, deterministic=True)
                seen, *_ = envs.step(actions)
                starts[:] = False
        except Exception as error:
            self._actions.put(error)


def wrapped(relay: Relay, record: EnvRecord, own: frozenset[str]) -> VecEnv:
    """Return the relay in a policy's wrappers.

    Args:
        relay: innermost.
        record: names the wrappers.
        own: names of the user's own among them, which may be imported.

    Raises:
        InputError: for one that cannot be made here, code that the user has not named, and wrappers whose arguments
            nobody knows, with the option that names them.
    """
    for each in (*record.wrappers, *record.vec_wrappers):
        if each.kwargs is None or not (each.name.startswith(_KNOWN) or each.name in own):
            words = " ".join(shlex.quote(_written(known)) for known in record.wrappers)
            missing = " (what is ... was not recorded)" if "(...)" in words else ""
            raise InputError(
                f"the policy was trained in {each.short}, a wrapper of its author's, whose code runs if you name all "
                f"of them{missing}: --wrappers {words}"
            )
    env: Any = reduce(_made, record.wrappers, relay)
    return cast(VecEnv, reduce(_made, record.vec_wrappers, DummyVecEnv([lambda: env])))


def _written(record: WrapperRecord) -> str:
    """Return a wrapper as `--wrappers` takes it."""
    known = "..." if record.kwargs is None else ", ".join(f"{k}={v!r}" for k, v in record.kwargs.items())
    return f"{record.name.replace(':', '.')}({known})"


def _made(env: Any, record: WrapperRecord) -> Any:
    try:
        kind = pkgutil.resolve_name(record.name)
        if not issubclass(kind, gym.Wrapper | VecEnvWrapper):
            raise TypeError("it is no wrapper")
        made: Any = kind(env, **{key: array_of(value) for key, value in (record.kwargs or {}).items()})
        for key, own in record.state.items():
            counted = made.obs_rms[key] if key else made.obs_rms
            counted.mean = np.full_like(counted.mean, own["mean"])
            counted.var = np.full_like(counted.var, own["var"])
            made.training = made.update_running_mean = False  # it counts no more
    except (Exception, SystemExit) as error:  # of whatever kind the wrapper's author chose
        raise InputError(f"wrapper {record.name} cannot be made: {first_line(error)[:160]}") from error
    return made
