"""Episodes of a served agent: takes observations, returns actions."""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from dexgrasp.agent import Info, renew_report, report_of
from dexgrasp.evaluation.protocol import DEFAULT_PROTOCOL, agent_settings, get_protocol
from dexgrasp.registry import make_agent
from dexgrasp_env.arrays import Arrays, Fields, numbers
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import jsonable
from dexgrasp_env.valid import NATURAL, check


class ServedAgents:
    """Agents of one name, an instance for each connection."""

    def __init__(self, name: str, robot: str | None) -> None:
        """Make an agent, and an environment for its observation and action spaces.

        Raises:
            InputError: for an unknown agent, or one that cannot act with the robot.
        """
        self._name = name
        self._free = [make_agent(name)]
        self._acting: dict[int, Any] = {}
        given = {} if robot is None else {"robot": robot}
        self.env_settings = agent_settings(name, self._free[0])
        protocol = get_protocol(DEFAULT_PROTOCOL)
        scene = {**protocol.scene, **self.env_settings, **given}
        env = gym.make(protocol.env_id, disable_env_checker=True, **scene)
        self._space = env.observation_space
        self._info: Fields = env.unwrapped.agent_info  # type: ignore[attr-defined]
        env.close()

    def metadata(self) -> Fields:
        """Return the agent's part of the first message of a connection."""
        cell, space = self._info["cell"], self._info["action_space"]
        return {
            "agent": self._name,
            "env_settings": jsonable(self.env_settings),
            "cell": cell.version,
            "control_period": self._info["control_period"],
            "action_low": space.low,
            "action_high": space.high,
        }

    def answer(self, connection: int, message: Fields) -> Fields:
        """Return actions (H, n) for an observation, and the report of the agent; none where it gave up.

        Args:
            connection: number of the connection; each has an episode of its own.
            message: arrays of the observation by name; `reset` is true where an episode begins (the first message of a
                connection begins one too), then with the agent's `seed` and the `info` of the environment's reset.

        Raises:
            InputError: for a message that is no observation.
        """
        observation = self._observation(message)
        agent = self._acting.get(connection)
        if agent is None or message.get("reset"):
            agent = self._begin(connection, observation, message)
        report = report_of(agent)
        given_up = bool(report.failure) and not report.again
        actions = np.zeros((0, *self._info["action_space"].shape))
        if not given_up:
            actions = np.atleast_2d(np.asarray(agent.act(observation), dtype=np.float64))
            report = report_of(agent)
        return {"actions": actions, "report": jsonable(vars(report))}

    def end(self, connection: int) -> None:
        """Free the agent of a closed connection for another one."""
        agent = self._acting.pop(connection, None)
        if agent is not None:
            self._free.append(agent)

    def _begin(self, connection: int, observation: Arrays, message: Fields) -> Any:
        info = message.get("info") or {}
        if not isinstance(info, Mapping):
            raise InputError("info is the mapping that the environment's reset returned")
        here, asked = self._info["cell"].version, info.get("cell")
        if asked not in (None, here):
            raise InputError("the episode is in another cell than the server's: start it with --robot")
        if connection not in self._acting:
            self._acting[connection] = self._free.pop() if self._free else make_agent(self._name)
        agent = self._acting[connection]
        renew_report(agent)
        agent.seed(check("seed", message.get("seed", 0), NATURAL))
        agent.reset(observation, self._info | dict(info) | {"cell": self._info["cell"]} | _space(info))
        return agent

    def _observation(self, message: Fields) -> Arrays:
        besides = ("reset", "seed", "info", "prompt")
        parts = self._space.spaces if isinstance(self._space, gym.spaces.Dict) else {}
        rule = numbers(f"an array of numbers: {', '.join(parts)} are")
        given = {key: check(key, value, rule) for key, value in message.items() if key not in besides}
        for key, space in parts.items():
            if key not in given:
                raise InputError(f"the observation lacks {key}: valid are {', '.join(parts)}")
            if given[key].shape != space.shape:
                raise InputError(f"{key} has shape {given[key].shape}: valid is {space.shape}")
            given[key] = given[key].astype(space.dtype, copy=False)
        return given


def _space(info: Info) -> Fields:
    """Return the action space in the `info` of a message, as agents read it."""
    if (given := info.get("action_space")) is None:
        return {}
    try:
        low, high = np.asarray(given["low"]), np.asarray(given["high"])
        return {"action_space": gym.spaces.Box(low, high, dtype=low.dtype.type)}
    except (TypeError, KeyError, ValueError, AssertionError, IndexError):
        raise InputError("action_space is a mapping of low and high, two arrays") from None
