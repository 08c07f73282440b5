"""The native vector environments: many simulations, one kernel, all cores."""

import copy
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from gymnasium.error import ClosedEnvironmentError
from gymnasium.utils import EzPickle, seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, create_empty_array
from numpy.random import Generator

from dexgrasp_env.arrays import AnyArray, Array, Arrays, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.tasks.batch import BatchPhysics
from dexgrasp_env.tasks.clear import ClearEnv
from dexgrasp_env.tasks.clutter import ClutterEnv
from dexgrasp_env.tasks.constants import MAX_EPISODE_STEPS
from dexgrasp_env.tasks.control import check_actions
from dexgrasp_env.tasks.gentle import GentleEnv
from dexgrasp_env.tasks.infos import infos_of, masked, of_one, with_masks
from dexgrasp_env.tasks.lift import LiftEnv
from dexgrasp_env.tasks.member import MemberAccess, one_for_each
from dexgrasp_env.tasks.place import GoalRewards, PlaceEnv
from dexgrasp_env.tasks.settings import PICTURES
from dexgrasp_env.tasks.simulation import Simulation
from dexgrasp_env.tasks.slots import EpisodeState, Starts
from dexgrasp_env.tasks.starts import valid_starts
from dexgrasp_env.valid import COUNT, NATURAL, Rule, check, instance, number


class ClosedError(InputError, ClosedEnvironmentError):
    """Error for use after `close()`: also Gymnasium's own."""


class LiftVectorEnv(MemberAccess, VectorEnv[Arrays, AnyArray, AnyArray], EzPickle):
    """N environments like `LiftEnv` that step together: `gym.make_vec("DexGrasp/Lift-v2", num_envs=N)`.

    Each has its own object, place, variation and random generator. Seeds, resets, time limits, autoreset, infos
    (`call("agent_info")` apart) and numbers are those of `gymnasium.vector.SyncVectorEnv` over N single environments,
    to the last bit, with any `threads`.

    ## Arguments, beside those of `LiftEnv`

    | Argument | Default | Valid |
    | --- | --- | --- |
    | `num_envs` | `1` | how many |
    | `max_episode_steps` | `300` | control steps after which an episode is truncated; None or -1 for no limit |
    | `autoreset_mode` | `'NextStep'` | `NextStep`, `SameStep`, `Disabled` |
    | `threads` | `None` | threads at a time; None for one a core |

    ## Physics on a GPU

    `backend="warp"` has mujoco_warp advance all worlds of `Lift` and `Place` at once, on `device`; progress, rewards
    and observations are computed on the host, and scenes of a seed are the same. What differs:

    - Nothing is equal to the last bit: numbers have single precision, the solver stops at 1e-6, not 1e-8, and a face
      that meets a box may have a corner more or less. Episodes agree until something collides.
    - A drawn object begins 0.7 mm above where it would have settled, and comes to rest within the episode.
    - A world without room for its contacts ends in `simulation_diverged`, with MuJoCo's `mjWARN_CONTACTFULL` or
      `mjWARN_CNSTRFULL`.
    - `randomisation` of `size` is for objects of boxes, cylinders, spheres and capsules: worlds share meshes.
    - An object that leaves the table falls through the floor.

    Colours of `obs_mode="rgbd"` want a GL; depth is by rays and wants none.
    """

    _env_type: type[LiftEnv] = LiftEnv

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = MAX_EPISODE_STEPS,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        **kwargs: Any,
    ) -> None:
        EzPickle.__init__(self, num_envs, max_episode_steps, autoreset_mode, threads, **kwargs)
        self.settings = self._env_type.settings_type.of(**kwargs)
        self.num_envs = check("num_envs", num_envs, COUNT)
        if self.settings.render_mode == "human":
            raise InputError("the vector environment has no 'human': use vectorization_mode='sync'")
        endless = max_episode_steps in (None, -1)  # -1 is Gymnasium's
        self._limit = math.inf if endless else check("max_episode_steps", max_episode_steps, COUNT)
        modes = Rule(", ".join(mode.value for mode in AutoresetMode), AutoresetMode)
        self.autoreset_mode = check("autoreset_mode", autoreset_mode, modes)
        fps = round(1 / self.settings.period)
        self.metadata = {
            "render_modes": list(PICTURES), "render_fps": fps, "autoreset_mode": self.autoreset_mode,
        }  # fmt: skip
        self.settings.warn_of_limit(self._limit)
        self.render_mode = self.settings.render_mode
        self._episodes = self._env_type.episodes_type(self.settings, num_envs)
        threads = None if threads is None else check("threads", threads, COUNT)
        if threads and self.settings.backend != "mujoco":
            raise InputError(
                f"threads={threads} changes nothing here: valid is backend='mujoco', or leave it out"
            )
        self._physics: Any
        if self.settings.backend == "warp":
            from dexgrasp_env.tasks.warp_batch import WarpPhysics

            self._physics = WarpPhysics(self._episodes)
        else:
            self._physics = BatchPhysics(self._episodes, threads)
        self.single_action_space = self._episodes.action_space
        self.single_observation_space = self._episodes.agent_space()
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._rngs, self._drawn_from = map(
            list, zip(*(seeding.np_random() for _ in range(num_envs)), strict=True)
        )
        self._observation: Any = create_empty_array(self._episodes.observation_space(), num_envs)
        self._notes: list[Fields] = [{} for _ in range(num_envs)]
        self._ended = np.ones(num_envs, bool)  # waiting for a reset
        self._started = np.zeros(num_envs, bool)

    @property
    def targets(self) -> Array:
        """Set-points of the servos as the agent has them, (N, n) rad."""
        return self._episodes.commands[:, 0].copy()

    # -- Gymnasium -----------------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Fields | None = None
    ) -> tuple[Arrays, Fields]:
        """Start episodes.

        Args:
            seed: of the first environment, the next ones have the numbers after it; or one for each.
            options: as for `LiftEnv.reset`, `state` also as a list, one for each; `reset_mask` (N,) bool says which are
                reset, all by default; with cameras those that have not begun have to be among them, as there is
                nothing to see of them.

        Raises:
            InputError: for a wrong number of seeds, a wrong mask, or what `LiftEnv.reset` refuses.
        """
        self.check_open("reset")
        seeds = _seeds(seed, self.num_envs)
        options = dict(check("options", options or {}, instance(Mapping, "a mapping, of all environments")))
        mask = options.pop("reset_mask", np.ones(self.num_envs, bool))
        if not (
            isinstance(mask, np.ndarray)
            and mask.shape == self._ended.shape
            and mask.dtype == bool
            and mask.any()
        ):
            raise InputError(
                f"reset_mask must be an array of {self.num_envs} booleans, one of them True at least"
            )
        state = options.pop("state", None)
        states = state if isinstance(state, list) else [state] * self.num_envs
        states = one_for_each("states", states, self.num_envs)
        left_out = np.flatnonzero(~mask & ~self._started).tolist()
        if left_out and self.settings.sees:
            raise InputError(
                f"reset_mask leaves out environments {left_out}, which have no episode to see yet"
            )
        for i in np.flatnonzero(mask).tolist():
            if seeds[i] is not None:
                self._rngs[i], self._drawn_from[i] = seeding.np_random(seeds[i])
            self._reset_one(i, options if states[i] is None else {**options, "state": states[i]})
        infos = self._infos()
        return self._observations(), infos if mask.all() else masked(infos, mask)

    def step(self, actions: AnyArray) -> tuple[Arrays, AnyArray, AnyArray, AnyArray, Fields]:
        """Advance every environment by 50 ms, or as long as an action stands for.

        Those that ended are reset as `autoreset_mode` says.

        Raises:
            InputError: for actions of a wrong shape or not finite, or if an environment needs a reset first.
        """
        self.check_open("step")
        clipped = check_actions(actions, self.action_space.shape)
        running, waiting = np.flatnonzero(~self._ended), np.flatnonzero(self._ended)
        if not self._started.all() or (self.autoreset_mode is AutoresetMode.DISABLED and self._ended.any()):
            raise InputError(
                f"step() called without running episodes in environments {waiting.tolist()}: reset them first"
            )
        rngs = [None if over else rng for rng, over in zip(self._rngs, self._ended, strict=True)]
        self._note(slice(None), self._episodes.advance(clipped, self._physics, rngs, running))
        if self.settings.sees:
            for i in running.tolist():
                self._look(i, self._physics.current.qpos[i], partial(self.simulation, i))
        for i in waiting.tolist():
            self._reset_one(i)
        rewards = self.settings.reward_scale * self._episodes.rewards
        rewards[waiting] = 0.0
        terminated, truncated = self._episodes.endings()
        truncated |= self._timed_out(self._episodes.records["elapsed"])
        self._ended = terminated | truncated
        final = self._finish() if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any() else {}
        return self._observations(), rewards, terminated, truncated, self._infos() | final

    def observe(self) -> tuple[Arrays, Fields]:
        """Return observations and infos of the last reset or step, or of the states that were set."""
        return self._observations(), self._infos()

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of each environment."""
        return self.call("render")

    def check_open(self, what: str) -> None:
        """Refuse a call once the environments are closed."""
        if self.closed:
            raise ClosedError(f"{what}() called on environments that are closed: make others")

    def _check_index(self, i: int) -> int:
        return check("environment", i, number(ge=0, le=self.num_envs - 1, whole=True))

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[Generator, ...]:  # type: ignore[override]
        """Random generators, one of each environment."""
        return tuple(self._rngs)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Seeds of these."""
        return tuple(self._drawn_from)

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads, free what rendering holds."""
        self._physics.close()
        self._episodes.views.close()

    # -- states --------------------------------------------------------------------------------------------------

    def get_state(self, i: int = 0) -> EpisodeState:
        """Return the state of environment `i`, as `LiftEnv.get_state`; either takes the other's.

        Raises:
            InputError: before its first reset, or for an index of none.
        """
        self.check_open("get_state")
        self._check_index(i)
        if not self._started[i]:
            raise InputError(f"get_state({i}) called without an episode: call reset() first")
        return self._episodes.get_state(
            i, self._physics.state(i), self._physics.current.sensors[i], self._rngs[i]
        )

    def set_state(self, state: EpisodeState, which: Iterable[int] | None = None) -> None:
        """Go on from a state, its count of steps included.

        Args:
            state: of `get_state`.
            which: the environments that go on from it; None for all.

        Raises:
            InputError: as `LiftEnv.set_state`, or for an index of none.
        """
        self.check_open("set_state")
        chosen = range(self.num_envs) if which is None else [*map(self._check_index, which)]
        for i in chosen:
            simulation = self._episodes.set_state(i, state, self._rngs[i])
            self._physics.load(i, simulation)
            seen = self._episodes.observe(i, simulation, copy.deepcopy(self._rngs[i]))
            self._note(slice(i, i + 1), seen)
            self._note(i, self._episodes.slots[i].view.seen)
            over = state.record["failure"] > 0 or self._timed_out(state.record["elapsed"])
            self._started[i], self._ended[i] = True, over

    def twin(self, **other: Any) -> LiftEnv:
        """Return a single environment of the same settings, but `other`, without an episode."""
        return self._env_type(**self._ezpickle_kwargs | other)

    def start_from(self, starts: Starts | None) -> None:
        """Set the source of options for resets that are given none, those within `step` too."""
        self._episodes.starts = valid_starts(starts)

    def __getstate__(self) -> Fields:
        """The constructor's arguments and the episodes: compiled models and threads are made anew."""
        return {
            "made": EzPickle.__getstate__(self),
            "spec": self.spec,
            "rngs": (self._rngs, self._drawn_from),
            "episodes": {i: self.get_state(i) for i in np.flatnonzero(self._started).tolist()},
            "ended": self._ended,
            "observation": self._observation,
            "starts": self._episodes.starts,
        }

    def __setstate__(self, kept: Fields) -> None:
        EzPickle.__setstate__(self, kept["made"])
        self.spec, self._episodes.starts = kept["spec"], kept["starts"]
        self._rngs, self._drawn_from = copy.deepcopy(kept["rngs"])
        for i, state in kept["episodes"].items():
            self.set_state(state, [i])
        self._observation = copy.deepcopy(kept["observation"])
        self._ended = kept["ended"].copy()

    def _timed_out(self, elapsed: Any) -> Any:
        """Return whether so many control steps, a number or (N,), are as many actions as an episode may have."""
        return -(-elapsed // self._episodes.span) >= self._limit

    # -- inside --------------------------------------------------------------------------------------------------

    def _reset_one(self, i: int, options: Fields | None = None) -> None:
        self._started[i], self._ended[i] = False, True  # options may be refused
        simulation, seen = self._episodes.begin(i, self._rngs[i], options)
        self._physics.load(i, simulation)
        self._note(slice(i, i + 1), seen)
        self._look(i, simulation.data.qpos, lambda: simulation, begins=True)
        self._started[i], self._ended[i] = True, False

    def _finish(self) -> Fields:
        """Return the last observations and infos of those that ended, and reset them."""
        ended, infos, now = self._ended.copy(), self._infos(), self._observations()
        last = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(ended).tolist():
            last[i] = copy.deepcopy(of_one(now, i))
            self._reset_one(i)
        final = {"final_obs": last, "final_info": masked(infos, ended)}
        return final | dict.fromkeys(("_final_obs", "_final_info"), ended)

    def _look(self, i: int, qpos: Array, scene: Callable[[], Simulation], begins: bool = False) -> None:
        self._episodes.look(i, qpos, scene, self._rngs[i], begins)
        self._note(i, self._episodes.slots[i].view.seen)

    def simulation(self, i: int) -> Simulation:
        """Return the scene of environment `i` with its model and present positions in it, until the next call."""
        simulation = self._episodes.enter(i)
        simulation.data.qpos[:] = self._physics.current.qpos[i, : simulation.base.nq]
        return simulation

    def _note(self, part: slice | int, seen: Arrays) -> None:
        for key, values in seen.items():
            if key in self._observation:
                self._observation[key][part] = values

    def _observations(self) -> Any:
        return self._episodes.as_agent_sees({key: values.copy() for key, values in self._observation.items()})

    def _infos(self) -> Fields:
        """Return the infos of the episodes, those of cameras too, with their masks."""
        infos, seen = infos_of(self._episodes), [slot.view.info for slot in self._episodes.slots]
        if self.settings.sees:
            infos |= {
                key: np.fromiter((info[key] for info in seen), object, len(seen))
                if isinstance(value, str | tuple)
                else np.array([info[key] for info in seen])
                for key, value in seen[0].items()
            }
        return with_masks(infos, self.num_envs)


class ClutterVectorEnv(LiftVectorEnv):
    """N environments like `ClutterEnv`, each with a scene of its own; see `LiftVectorEnv`."""

    _env_type = ClutterEnv


class GentleVectorEnv(LiftVectorEnv):
    """N environments like `GentleEnv`; see `LiftVectorEnv`."""

    _env_type = GentleEnv


class ClearVectorEnv(LiftVectorEnv):
    """N environments like `ClearEnv`, each with a scene of its own; see `LiftVectorEnv`."""

    _env_type = ClearEnv


class PlaceVectorEnv(GoalRewards, LiftVectorEnv):
    """N environments like `PlaceEnv`; see `LiftVectorEnv`."""

    _env_type = PlaceEnv


def _seeds(seed: Any, number: int) -> list[int | None]:
    """Return the seed of each environment."""
    if seed is None or np.ndim(seed) == 0:
        return [None if seed is None else check("seed", seed, NATURAL) + i for i in range(number)]
    seeds = one_for_each("seeds", list(seed), number)
    return [None if each is None else check("seed", each, NATURAL) for each in seeds]
