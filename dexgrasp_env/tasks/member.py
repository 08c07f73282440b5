"""Single environments inside of a vector environment, as `get_attr`, `set_attr` and `call` see them."""

import copy
from typing import Any

import mujoco
from numpy.random import Generator

from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.tasks.slots import EpisodeState

_SHARED = ("settings", "metadata", "render_mode", "spec", "compute_reward")


class Member:
    """Environment `i` of a vector environment: attributes of `LiftEnv`, and those that a user has set.

    It has no `reset` and no `step`: environments that are side by side step together.
    """

    def __init__(self, envs: Any, i: int, notes: Fields) -> None:
        """Name the environment of a `LiftVectorEnv`; `notes` are the attributes that a user has set."""
        self._envs, self._i, self._notes = envs, i, notes
        self.action_space, self.observation_space = envs.single_action_space, envs.single_observation_space

    @property
    def target(self) -> str:
        """The object of the episode, as `objects` names it."""
        return self._envs.target(self._i)

    @property
    def targets(self) -> Array:
        """Set-points of the servos as the agent has them, (n,) rad."""
        return self._envs.targets[self._i]

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model of the episode, with its variation: a copy."""
        return copy.copy(self._envs.simulation(self._i).model)

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's data at the present positions: a copy."""
        return copy.copy(self._envs.simulation(self._i).data)

    @property
    def np_random(self) -> Generator:
        """Random generator of the environment."""
        return self._envs.generator(self._i)

    @property
    def dt(self) -> float:
        """Seconds of a control step."""
        return self._envs.settings.period

    @property
    def disturbance_steps(self) -> int:
        """Control steps that the disturbance takes."""
        return self._envs.settings.disturbance_steps

    def get_state(self) -> EpisodeState:
        """Return the state of the episode; see `LiftEnv.get_state`."""
        return self._envs.get_state(self._i)

    def set_state(self, state: EpisodeState) -> None:
        """Go on from a state; see `LiftEnv.set_state`."""
        self._envs.set_state(state, [self._i])

    def render(self) -> Any:
        """Return a picture."""
        return self._envs.render_one(self._i)

    def set(self, name: str, value: Any) -> None:
        """Set an attribute of the user's own.

        Raises:
            AttributeError: for one that is the environment's.
        """
        if name in _SHARED or name in vars(self) or hasattr(type(self), name):
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
        own = [key for key in (*vars(type(self)), *vars(self)) if not key.startswith("_") and key != "set"]
        raise AttributeError(
            f"unknown attribute {name!r}: valid are {', '.join((*own, *_SHARED, *self._notes))}"
        )


class MemberAccess:
    """Access to the single environments, as Gymnasium's own vector environments give it."""

    num_envs: int
    _notes: list[Fields]  # attributes that users have set, of each

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return what a method of each environment returns, or an attribute of each; see `Member`."""
        found = self.get_attr(name)
        return tuple(part(*args, **kwargs) if callable(part) else part for part in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each environment; see `Member`."""
        return tuple(getattr(member, name) for member in self._members())

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of one's own: one value for all, or a list or tuple with one for each.

        Raises:
            AttributeError: for an attribute of the environment's.
            InputError: for a wrong number of values.
        """
        several = list(values) if isinstance(values, list | tuple) else [values] * self.num_envs
        for member, value in zip(
            self._members(), one_for_each("values", several, self.num_envs), strict=True
        ):
            member.set(name, value)

    def _members(self) -> list[Member]:
        return [Member(self, i, notes) for i, notes in enumerate(self._notes)]


def one_for_each(what: str, values: list[Any], number: int) -> list[Any]:
    """Return values, one for each of so many environments; raises an InputError for another number of them."""
    if len(values) != number:
        raise InputError(f"{len(values)} {what} given: valid is one, or one for each of {number}")
    return values
