"""One environment at a time: an episode begun, stepped, observed, kept, set and drawn."""

import copy
from typing import Any, Self

import gymnasium as gym
import numpy as np
from gymnasium.utils import EzPickle

from dexgrasp_env.arrays import Arrays, Fields, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.scene.constants import CONTROL_PERIOD
from dexgrasp_env.tasks.control import check_actions
from dexgrasp_env.tasks.episodes import Episodes
from dexgrasp_env.tasks.infos import info_of
from dexgrasp_env.tasks.member import EpisodeAccess
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.slots import EpisodeState, Starts
from dexgrasp_env.tasks.starts import valid_starts
from dexgrasp_env.valid import NATURAL, check


class SingleEnv(EpisodeAccess, gym.Env[Arrays, Single], EzPickle):
    """Base of single environments of all tasks.

    Attributes:
        episodes_type: of the task.
        settings_type: states the arguments that it takes, and checks them.
    """

    episodes_type = Episodes
    settings_type: type[LiftSettings] = LiftSettings
    metadata = {  # noqa: RUF012  (as Gymnasium has it)
        "render_modes": ["human", "rgb_array", "depth_array"],
        "render_fps": round(1 / CONTROL_PERIOD),
    }

    def __init__(self, **given: Any) -> None:
        EzPickle.__init__(self, **given)
        self.settings = self.settings_type.of(**given)
        self.render_mode = self.settings.render_mode
        self.metadata = {**self.metadata, "render_fps": round(1 / self.dt)}
        self._episodes = self.episodes_type(self.settings, 1)
        self.action_space, self.observation_space = self._episodes.action_space, self._episodes.agent_space()
        self.simulation = next(iter(self._episodes.simulations.values()))
        if self.settings.backend == "warp":
            from dexgrasp_env.tasks.warp_batch import WarpPhysics

            physics = WarpPhysics(self._episodes)
            for simulation in self._episodes.simulations.values():
                simulation.physics = physics
        self._over = True

    def reset(self, *, seed: int | None = None, options: Fields | None = None) -> tuple[Arrays, Fields]:
        """Start an episode.

        Args:
            seed: of every draw of this and the following episodes.
            options: `object` names one of the environment's objects; `object_pose` is (7,) position m and quaternion
                wxyz of the object in the world frame. Or `state`, of `get_state`, where the episode is to begin; it has
                an object and a pose of its own.

        Raises:
            InputError: for an unknown option or object, or a pose that cannot be.
        """
        super().reset(seed=None if seed is None else check("seed", seed, NATURAL))
        # The limit is a wrapper's: where the last episode ended shows it.
        self.settings.warn_of_limit(int(self._episodes.records["elapsed"][0]))
        self._over = True  # options may be refused
        self.simulation, seen = self._episodes.begin(0, self.np_random, options)
        self._over = False
        observation, info = self._look(seen, begins=True)
        return observation, info | self.agent_info

    def observe(self) -> tuple[Arrays, Fields]:
        """Return observation and info of the present: those of the last reset or step, or of the state that was set.

        Nothing moves, and no camera looks again; where joint sensors are noisy, their noise is drawn anew.

        Raises:
            InputError: before the first reset.
        """
        self.get_state()
        return self._observed(self._episodes.observe(0, self.simulation, copy.deepcopy(self.np_random)))

    def step(self, action: Single) -> tuple[Arrays, float, bool, bool, Fields]:
        """Advance 50 ms, or as long as an action stands for.

        Raises:
            InputError: if the action has the wrong shape or is not finite, or no episode is running.
        """
        if self._over:
            raise InputError("step() called without a running episode: call reset() first")
        episodes = self._episodes
        actions = check_actions(action, self.action_space.shape)[None]
        seen = episodes.advance(actions, self.simulation, [self.np_random], np.arange(1))
        terminated, truncated = (bool(flags[0]) for flags in episodes.endings())
        self._over = terminated or truncated
        reward = float(self.settings.reward_scale * episodes.rewards[0])
        observation, info = self._look(seen)
        return observation, reward, terminated, truncated, info

    def twin(self, **other: Any) -> Self:
        """Return another environment of the same settings, but `other`, without an episode."""
        return type(self)(**self._ezpickle_kwargs | other)

    def start_from(self, starts: Starts | None) -> None:
        """Set the source of options for resets that are given none."""
        self._episodes.starts = valid_starts(starts)

    def _look(self, observed: Arrays, begins: bool = False) -> tuple[Arrays, Fields]:
        self._episodes.look(0, self.data.qpos, lambda: self.simulation, self.np_random, begins)
        if self.render_mode == "human":
            self.render()
        return self._observed(observed)

    def _observed(self, observed: Arrays) -> tuple[Arrays, Fields]:
        """Return the observation and the info, both with what cameras saw last: callers may write to that."""
        view = self._episodes.slots[0].view
        observation, info = {key: values[0] for key, values in observed.items()}, info_of(self._episodes, 0)
        if view.seen:
            seen, about = copy.deepcopy((view.seen, view.info))
            observation, info = dict(sorted((observation | seen).items())), info | about
        return self._episodes.as_agent_sees(observation), info

    def get_state(self) -> EpisodeState:
        """Return everything that the running episode's future depends on.

        Raises:
            InputError: before the first reset.
        """
        if not self._episodes.slots[0].target:
            raise InputError("get_state() called without an episode: call reset() first")
        return self._episodes.get_state(0, self.simulation.get_state(), self.data.sensordata, self.np_random)

    def set_state(self, state: EpisodeState) -> None:
        """Go on from a state, of this environment or of another with the same settings.

        Raises:
            InputError: if the state is of an object that is not among this environment's, or of other settings.
        """
        self.simulation = self._episodes.set_state(0, state, self.np_random)
        self._over = bool(state.record["failure"])

    def __getstate__(self) -> Fields:
        """The constructor's arguments and the episode: compiled models and windows are made anew."""
        episode = self.get_state() if self._episodes.slots[0].target else None
        return {
            "made": EzPickle.__getstate__(self),
            "episode": episode,
            "spec": self.spec,
            "seed": self._np_random_seed,
            "starts": self._episodes.starts,
        }

    def __setstate__(self, kept: Fields) -> None:
        EzPickle.__setstate__(self, kept["made"])
        self.spec = kept["spec"]
        self._episodes.starts = kept["starts"]
        if kept["episode"] is not None:
            self.set_state(kept["episode"])
            self._np_random_seed = kept["seed"]

    def render(self) -> Any:
        """Return a picture (`rgb_array`: (H, W, 3) uint8; `depth_array`: (H, W) float32 m), or show it (`human`)."""
        return self._episodes.views.render(self.render_mode, self.simulation)

    def close(self) -> None:
        """Free what rendering holds."""
        self._episodes.views.close()
