"""Attributes of an environment: of a single one, and of those inside of a vector environment."""

import copy
from typing import Any, Self

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array, Arrays, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.tasks.episodes import Episodes
from dexgrasp_env.tasks.infos import of_one
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import Simulation
from dexgrasp_env.tasks.slots import EpisodeState

_SHARED = ("metadata", "render_mode", "spec", "compute_reward", "twin")
"""Attributes of a vector environment that its members have as well."""


class EpisodeAccess:
    """Attributes of one environment, by its settings and episode."""

    settings: LiftSettings
    action_space: Any
    observation_space: Any
    simulation: Simulation
    """Scene of the episode, for pictures and evaluation; agents see observations only."""
    _episodes: Episodes
    _i = 0  # its slot

    @property
    def target(self) -> str:
        """The object of the episode, as `objects` names it: a name, or the path as it was given."""
        return self._episodes.slots[self._i].target

    @property
    def targets(self) -> Array:
        """Set-points of the servos as the agent has them, (n,) rad."""
        return self._episodes.commands[self._i, 0].copy()

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model of the episode, with its variation; a member's is a copy."""
        return self.simulation.model

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's live data: the full integration state after every reset and step; `ctrl` the last set-points.

        A member's is a copy, with the present positions.
        """
        return self.simulation.data

    @property
    def dt(self) -> float:
        """Seconds of a control step."""
        return self.settings.period

    @property
    def steps_per_action(self) -> int:
        """Control steps of an action, at most."""
        return self._episodes.span

    @property
    def disturbance_steps(self) -> int:
        """Control steps that the disturbance takes: what a time limit should allow for."""
        return self.settings.disturbance_steps

    @property
    def agent_info(self) -> Fields:
        """Settings that an agent may know; the info of every reset has them."""
        own = {"action_space": self.action_space, "observation_space": self.observation_space}
        return {**own, **self.settings.agent_info}


class Member(EpisodeAccess):
    """Environment `i` of a vector environment: attributes of `LiftEnv`, and those that a user has set.

    It has no `step`: environments that are side by side step together.
    """

    def __init__(self, envs: Any, i: int, notes: Fields) -> None:
        """Name the environment of a `LiftVectorEnv`; `notes` are the attributes that a user has set."""
        self._envs, self._i, self._notes = envs, i, notes
        self._episodes, self.settings = envs._episodes, envs.settings
        self.action_space, self.observation_space = envs.single_action_space, envs.single_observation_space
        self.np_random, self.np_random_seed = envs.np_random[i], envs.np_random_seed[i]

    @property
    def unwrapped(self) -> Self:
        """The environment itself: nothing wraps it."""
        return self

    @property
    def simulation(self) -> Simulation:  # type: ignore[override]
        """Scene of the episode at the present positions: a copy."""
        simulation = copy.copy(self._envs.simulation(self._i))
        simulation.model, simulation.data = copy.copy(simulation.model), copy.copy(simulation.data)
        return simulation

    def reset(self, *, seed: int | None = None, options: Fields | None = None) -> tuple[Arrays, Fields]:
        """Start an episode here alone; see `LiftEnv.reset`."""
        mask = np.arange(self._envs.num_envs) == self._i
        seeds = [seed if own else None for own in mask]
        return self._mine(*self._envs.reset(seed=seeds, options={**(options or {}), "reset_mask": mask}))

    def observe(self) -> tuple[Arrays, Fields]:
        """Return observation and info of the last reset or step."""
        self.get_state()
        return self._mine(*self._envs.observe())

    def _mine(self, observations: Arrays, infos: Fields) -> tuple[Arrays, Fields]:
        return of_one(observations, self._i), of_one(infos, self._i) | self.agent_info

    def get_state(self) -> EpisodeState:
        """Return the state of the episode; see `LiftEnv.get_state`."""
        return self._envs.get_state(self._i)

    def set_state(self, state: EpisodeState) -> None:
        """Go on from a state; see `LiftEnv.set_state`."""
        self._envs.set_state(state, [self._i])

    def render(self) -> Any:
        """Return a picture."""
        self._envs.check_open("render")
        simulation = self._envs.simulation(self._i)
        mujoco.mj_forward(simulation.model, simulation.data)
        return self._episodes.views.render(self._envs.render_mode, simulation)

    def set(self, name: str, value: Any) -> None:
        """Set an attribute of the user's own.

        Raises:
            AttributeError: for one that is the environment's.
        """
        if name in _SHARED or name in dir(self):
            raise AttributeError(
                f"{name} of an environment cannot be set: make it with other arguments, or reset it"
            )
        self._notes[name] = value

    def __getattr__(self, name: str) -> Any:
        """Return an attribute that all environments share, or one of the user's own."""
        if name in _SHARED and hasattr(self._envs, name):
            return getattr(self._envs, name)
        if name in self._notes:
            return self._notes[name]
        own = [key for key in dir(self) if not key.startswith("_") and key != "set"]
        raise AttributeError(
            f"unknown attribute {name!r}: valid are {', '.join((*own, *_SHARED, *self._notes))}"
        )


class MemberAccess:
    """Access to the single environments, as Gymnasium's own vector environments give it."""

    num_envs: int
    _notes: list[Fields]  # attributes that users have set, of each

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return what a method of each environment returns, or an attribute of each; see `Member`."""
        found = [getattr(member, name) for member in self.members]
        return tuple(part(*args, **kwargs) if callable(part) else part for part in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each environment, or what a method returns; see `Member`."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of one's own: one value for all, or a list or tuple with one for each.

        Raises:
            AttributeError: for an attribute of the environment's.
            InputError: for a wrong number of values.
        """
        several = list(values) if isinstance(values, list | tuple) else [values] * self.num_envs
        for member, value in zip(self.members, one_for_each("values", several, self.num_envs), strict=True):
            member.set(name, value)

    @property
    def members(self) -> list[Member]:
        """The single environments."""
        return [Member(self, i, notes) for i, notes in enumerate(self._notes)]


def one_for_each(what: str, values: list[Any], number: int) -> list[Any]:
    """Return values, one for each of so many environments; raises an InputError for another number of them."""
    if len(values) != number:
        raise InputError(f"{len(values)} {what} given: valid is one, or one for each of {number}")
    return values
