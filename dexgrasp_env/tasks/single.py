"""One environment at a time: an episode begun, stepped, observed, kept, set and drawn."""

import copy
from typing import Any, Self

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium.utils import EzPickle
from numpy.random import Generator

from dexgrasp_env.arrays import Array, Arrays, Fields, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.scene.constants import CONTROL_PERIOD
from dexgrasp_env.tasks.control import ActionSpace, check_actions
from dexgrasp_env.tasks.episodes import Episodes
from dexgrasp_env.tasks.moving import drive_belt
from dexgrasp_env.tasks.observations import FLAT, OBS_SUMS
from dexgrasp_env.tasks.physics import give_physics
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.slots import EpisodeState, Starts


class SingleEnv(gym.Env[Arrays, Single], EzPickle):
    """Base of single environments of all tasks.

    Attributes:
        episodes_type: of the task.
        settings_type: says which arguments it takes, and checks them.
        obs_modes: those that it takes.
        simulation: of the episode, for pictures and evaluation; agents see observations only.
    """

    episodes_type = Episodes
    settings_type: type[LiftSettings] = LiftSettings
    obs_modes: tuple[str, ...] = (*OBS_SUMS, FLAT)
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
        self._views = self._episodes.views
        s = self.settings
        self.action_space = ActionSpace(  # type: ignore[assignment]
            s.control_mode, s.cell.robot, s.frame_skip, s.action_scale, s.hold
        )
        self.observation_space = self._episodes.told_space()
        self.simulation = next(iter(self._episodes.simulations.values()))
        give_physics(self._episodes)
        self._over = True

    @property
    def target(self) -> str:
        """The object of the episode, as `objects` names it: a name, or the path as it was given."""
        return self._episodes.slots[0].target

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model of the episode, with its variation."""
        return self.simulation.model

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's live data: the full integration state after every reset and step; `ctrl` the last set-points."""
        return self.simulation.data

    @property
    def dt(self) -> float:
        """Seconds of a control step."""
        return self.settings.period

    @property
    def steps_an_action(self) -> int:
        """Control steps of an action, at most."""
        return self._episodes.span

    @property
    def targets(self) -> Array:
        """Set-points of the servos as the agent has them, (n,) rad."""
        return self._episodes.commands[0, 0].copy()

    @property
    def agent_info(self) -> Fields:
        """Settings that an agent may know; the info of every reset has them."""
        spaces = {"action_space": self.action_space, "observation_space": self.observation_space}
        return {**spaces, **self.settings.agent_info}

    @property
    def disturbance_steps(self) -> int:
        """Control steps that the disturbance takes: what a time limit should allow for."""
        return self.settings.disturbance_steps

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
        super().reset(seed=seed)
        # The limit is a wrapper's: where the last episode ended shows it.
        self.settings.warn_of_limit(int(self._episodes.records["elapsed"][0]))
        self._over = True  # options may be refused
        self.simulation, seen = self._episodes.begin(0, self.np_random, options)
        self._over, slot = False, self._episodes.slots[0]
        observation, info = self._look(self._complete(seen), at_reset=not (slot.resumed and slot.view.seen))
        return observation, info | self.agent_info

    def observe(self) -> tuple[Arrays, Fields]:
        """Return observation and info of the present: those of the last reset or step, or of the state that was set.

        Nothing moves, and no camera looks again; where joint sensors are noisy, their noise is drawn anew.

        Raises:
            InputError: before the first reset.
        """
        self.get_state()
        return self._told(self._complete(self._conclude(0, copy.deepcopy(self.np_random), judge=False)))

    def step(self, action: Single) -> tuple[Arrays, float, bool, bool, Fields]:
        """Advance 50 ms, or as long as an action stands for.

        Raises:
            InputError: if the action has the wrong shape or is not finite, or no episode is running.
        """
        episodes, gained = self._episodes, 0.0
        actions = self._checked(action)
        for step in range(episodes.span):
            seen = self._conclude(self.simulation.step(self._start(actions, step)))
            gained += episodes.rewards[0]
            if not episodes.undecided()[0]:
                break
        return self._finish(seen, gained)

    def twin(self, **other: Any) -> Self:
        """Return another environment of the same settings, but `other`, without an episode."""
        return type(self)(**self._ezpickle_kwargs | other)

    def start_from(self, starts: Starts | None) -> None:
        """Set the source of options for resets that are given none."""
        self._episodes.starts = starts

    def start_step(self, action: Single) -> Array:
        """Begin a step of one control step, before the physics: move the set-points, and push what is to be pushed.

        Args:
            action: as for `step`.

        Returns:
            Set-points of the physics steps (1, frame_skip, n) rad, for `simulation.step`.

        Raises:
            InputError: as `step`.
        """
        if self._episodes.span > 1:
            raise InputError("an action takes several control steps here: call step()")
        return self._start(self._checked(action), 0)

    def _checked(self, action: Single) -> Array:
        if self._over:
            raise InputError("step() called without a running episode: call reset() first")
        return check_actions(action, self.action_space.shape)[None]

    def _start(self, actions: Array, step: int) -> Array:
        rows, push = self._episodes.set_points(actions, self.simulation, step)
        if self.settings.disturbance.kind == "pushed":
            self.data.xfrc_applied[self.simulation.body, :3] = push[0]
        elif self.simulation.belt:
            drive_belt(self.data.qpos, self.data.qvel, self.settings.cell.robot.dof, push[0])
        return rows

    def finish_step(self, bits: int) -> tuple[Arrays, float, bool, bool, Fields]:
        """Finish a step, after the physics: judge and observe.

        Args:
            bits: the physics' warnings, as `simulation.step` returns them.

        Returns:
            What `step` returns.
        """
        return self._finish(self._conclude(bits), float(self._episodes.rewards[0]))

    def _finish(self, seen: Arrays, gained: float) -> tuple[Arrays, float, bool, bool, Fields]:
        episodes = self._episodes
        terminated, truncated = (bool(flags[0]) for flags in episodes.endings())
        self._over = terminated or truncated
        observation, info = self._look(self._complete(seen), at_reset=False)
        return observation, float(self.settings.reward_scale * gained), terminated, truncated, info

    def _complete(self, seen: Arrays) -> Arrays:
        return self._episodes.complete(slice(None), self.simulation, seen)

    def _conclude(self, bits: int, rng: Generator | None = None, judge: bool = True) -> Arrays:
        rngs = [rng or self.np_random]
        return self._episodes.conclude(slice(None), self.simulation, np.array([bits]), rngs, judge)

    def _look(self, observed: Arrays, at_reset: bool) -> tuple[Arrays, Fields]:
        if self.settings.sees:
            view = self._episodes.slots[0].view
            self._views.observe(view, self.data.qpos, lambda: self.simulation, self.np_random, at_reset)
        if self.render_mode == "human":
            self.render()
        return self._told(observed)

    def _told(self, observed: Arrays) -> tuple[Arrays, Fields]:
        """Return the observation and the info, both with what cameras saw last: callers may write to that."""
        view = self._episodes.slots[0].view
        seen, info = copy.deepcopy((view.seen, view.info)) if view.seen else ({}, {})
        observation = {key: values[0] for key, values in observed.items()} | seen
        return self._episodes.told(dict(sorted(observation.items()))), self._episodes.info(0) | info

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
        return self._views.render(self.render_mode, self.simulation)

    def close(self) -> None:
        """Free what rendering holds."""
        self._views.close()
