"""The tasks as `dm_control.rl.control.Environment`s, for users of that ecosystem.

env = dexgrasp_env.dm.load(objects="seen", control_mode="joint_delta")
timestep = env.reset()
timestep = env.step(action)
env.physics.named.data.xpos["object"]

dm_control's viewer, pixel wrapper and action wrappers run on it. Where there is no screen, import this module before
dm_control, or set MUJOCO_GL: dm_control settles on a GL library when it is imported.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, SupportsFloat

import gymnasium as gym
import mujoco
from gymnasium import spaces

from dexgrasp_env import rendering
from dexgrasp_env.arrays import Arrays, Fields, Single
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.extras import from_extra
from dexgrasp_env.tasks.lift import LiftEnv
from dexgrasp_env.tasks.simulation import Simulation

rendering.use_offscreen_gl()  # dm_control settles on a backend when it is imported
with from_extra():
    from dm_control import mujoco as dm_mujoco
    from dm_control.mujoco.wrapper import MjData
    from dm_control.rl import control
    from dm_env import specs


def load(
    objects: str | list[str] | tuple[str, ...] = "ycb6",
    *,
    env_id: str = "DexGrasp/Lift-v2",
    seed: int | None = None,
    flat_observation: bool = False,
    **kwargs: Any,
) -> control.Environment:
    """Return an environment of dm_control: the observations, rewards and time limit of Gymnasium's, step by step.

    An episode that terminates ends with discount 0; one that is truncated, as by the time limit, ends with discount 1,
    since its state had a future.

    Args:
        objects: as for `gym.make`.
        env_id: of which environment.
        seed: of all episodes; None draws one.
        flat_observation: whether all observations are put into one array.
        kwargs: everything else that `gym.make(env_id)` accepts.

    Raises:
        InputError: if an argument is wrong.
    """
    known = sorted(name for name in gym.registry if name.startswith("DexGrasp/"))
    if env_id not in known:
        raise unknown_name("env_id", env_id, known)
    task = Task(gym.make(env_id, objects=objects, disable_env_checker=True, **kwargs), seed)
    return control.Environment(
        Physics(task.inner.simulation), task, n_sub_steps=task.inner.settings.frame_skip,
        flat_observation=flat_observation, legacy_step=False,
    )  # fmt: skip


class Physics(dm_mujoco.Physics):
    """The environment's own model and data: what is written here, the environment simulates.

    They are of the episode's object: `model` and `data` are others once an episode has another object.
    """

    advance: Callable[[], None] | None = None
    """Advances the environment by the control step that a task has begun."""

    def __init__(self, simulation: Simulation) -> None:
        super().__init__(MjData(simulation.data))
        self._shown = simulation, simulation.variation.size

    def show(self, simulation: Simulation) -> None:
        """Take over the scene of a new episode; a GL context holds meshes in the size that they had."""
        shown = simulation, simulation.variation.size
        if shown != self._shown:
            self._shown = shown
            self._reload_from_data(MjData(simulation.data))

    def step(self, nstep: int = 1) -> None:
        """Advance the control step that a task has begun, else `nstep` physics steps under `data.ctrl`."""
        advance, self.advance = self.advance, None
        if advance is None:
            super().step(nstep)
            return
        advance()
        mujoco.mj_kinematics(self.model.ptr, self.data.ptr)  # dm_control's users read positions of now

    def after_reset(self) -> None:
        """Do nothing: the environment's reset leaves everything current, and another pass would change its bits."""


class Task(control.Task):
    """A task of Gymnasium's environment, on the physics that dm_control advances."""

    def __init__(self, env: gym.Env[Any, Any], seed: int | None = None) -> None:
        inner = env.unwrapped
        assert isinstance(inner, LiftEnv)
        seen: Any = inner.observation_space
        if inner.steps_per_action > 1 or not isinstance(seen, spaces.Dict):
            raise InputError(
                "dm_control has an action a control step, and observations by name: valid are hold=1, a control_mode "
                "but grasp_once, an obs_mode but features"
            )
        self.inner, self._env, self._seed = inner, env, seed
        self.info: Fields = {}
        """What Gymnasium's `info` says of the last step: is_success, failure, reward_terms, ..."""

    def initialize_episode(self, physics: Physics) -> None:
        """Start an episode of the environment."""
        self._seen, self.info = self._env.reset(seed=self._seed)
        self._seed = None  # later episodes go on with the same generator
        self._terminated, self._truncated = False, False
        physics.show(self.inner.simulation)

    def before_step(self, action: Single, physics: Physics) -> None:
        """Begin a step, which the physics carry out."""
        physics.advance = partial(self._step, action)

    def _step(self, action: Single) -> None:
        told = self._env.step(action)
        self._seen, self._reward, self._terminated, self._truncated, self.info = told

    def get_observation(self, physics: Physics) -> Arrays:
        """Return Gymnasium's observation."""
        return dict(self._seen)

    def get_reward(self, physics: Physics) -> SupportsFloat:
        """Return Gymnasium's reward."""
        return self._reward

    def get_termination(self, physics: Physics) -> float | None:
        """Return the last discount, None while the episode runs."""
        if self._terminated:
            return 0.0
        return 1.0 if self._truncated else None

    def observation_spec(self, physics: Physics) -> dict[str, specs.Array]:
        """Return a spec for every key of the observations."""
        space = self.inner.observation_space
        assert isinstance(space, spaces.Dict)
        return {key: _spec(key, part) for key, part in space.items()}

    def action_spec(self, physics: Physics) -> specs.BoundedArray:
        """Return the actions' spec: within [-1, 1]."""
        return _spec("action", self.inner.action_space)


def _spec(name: str, space: gym.Space[Any]) -> Any:
    if isinstance(space, spaces.MultiBinary):
        return specs.BoundedArray(space.shape, space.dtype, 0, 1, name=name)
    if not isinstance(space, spaces.Box):
        raise InputError(f"space {name!r} is a {type(space).__name__}: valid are Box and MultiBinary")
    if space.is_bounded():
        return specs.BoundedArray(space.shape, space.dtype, space.low, space.high, name=name)
    return specs.Array(space.shape, space.dtype, name=name)
