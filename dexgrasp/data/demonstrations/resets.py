"""Reverse curriculum: episodes that begin at states of demonstrations, at first near success, later further back."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from dexgrasp.agent import Env
from dexgrasp.data.demonstrations.generate import read_about
from dexgrasp.data.demonstrations.hdf5_formats import read_episodes
from dexgrasp.data.demonstrations.rollout import Demonstration, follow_set_points
from dexgrasp.data.demonstrations.settings import ENV_ID, DemoSettings
from dexgrasp_env.arrays import Array, Fields, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.scene.constants import CONTROL_STEPS
from dexgrasp_env.tasks.constants import GOAL_STEPS
from dexgrasp_env.tasks.control import DIRECT_MODES, GRASP_MODES
from dexgrasp_env.tasks.lift import LiftEnv
from dexgrasp_env.tasks.place import PlaceEnv
from dexgrasp_env.tasks.randomisation import ranges
from dexgrasp_env.tasks.slots import EpisodeState
from dexgrasp_env.tasks.starts import ReverseStarts
from dexgrasp_env.tasks.vector import LiftVectorEnv
from dexgrasp_env.tasks.views import CameraViews


class DemoResets(ReverseStarts):
    """Initial states of episodes: states of demonstrations from `front` on, and a share of the usual ones.

        resets = DemoResets("runs/demos").attach(envs)

    Resets with options of their own are left as they are. In `Place` the goal is where a demonstration ends. Camera
    observations are stored once for each view; with `observe="step"` cameras look again at these resets.

    Attributes:
        states: of each demonstration, in order of time.
    """

    def __init__(self, folder: str | Path, whole: float = 0.2) -> None:
        """Read demonstrations.

        Args:
            folder: of `dexgrasp demos generate`.
            whole: share of the episodes with the usual initial state.

        Raises:
            InputError: if there are none, they are damaged, or of sizes that each scene drew.
        """
        super().__init__(whole)
        folder = expand(folder)
        self._settings = DemoSettings.of_json(read_about(folder)["settings"])
        if "size" in ranges(self._settings.randomise):
            raise InputError(
                f"{folder} has demonstrations at drawn sizes: episodes begin along those made without "
                "--randomise size alone, whose objects are as large as an environment's"
            )
        self._demos = [_followed(demo) for demo in islice(read_episodes(folder), 100)]
        self.states: list[list[EpisodeState]] = []

    def attach(self, env: Env | gym.vector.VectorEnv[Any, Any, Any]) -> "DemoResets":
        """Replay the demonstrations in a copy of an environment, single or vector, and let its episodes begin there.

        Demonstrations that fail under its settings (another friction, pushes) are left out.

        Raises:
            InputError: if it is no environment of ours or of another control period, every demonstration fails there,
                or one for `Place` does not record where it ends.
        """
        inner: Any = env.unwrapped
        if not isinstance(inner, LiftEnv | LiftVectorEnv):
            raise InputError(f"demonstrations are of DexGrasp environments, not of {type(inner).__name__}")
        self._check(inner)
        mode = inner.settings.control_mode
        # Whoever follows set-points commands them, one a control step; the episodes go on in the other's mode.
        following = {"hold": 1} | ({"control_mode": "joint_position"} if mode in GRASP_MODES else {})
        own = inner.twin(**following)
        if isinstance(own, PlaceEnv):
            self._won = "at_goal", GOAL_STEPS
        self.states = [found for demo in self._demos if (found := self._follow(own, demo))]
        own.close()
        self.states = [
            [replace(state, of={**state.of, "control_mode": mode}) for state in states]
            for states in self.states
        ]
        if not self.states:
            raise InputError("no demonstration succeeds in this environment: give those of its objects")
        inner.start_from(self)
        return self

    def _check(self, inner: Any) -> None:
        """Refuse an environment of another pace, or another robot."""
        if inner.settings.frame_skip != CONTROL_STEPS:
            raise InputError(
                f"frame_skip is {inner.settings.frame_skip}: demonstrations are set-points {CONTROL_STEPS} physics "
                "steps apart, and can be followed at that pace alone"
            )
        recorded = make_cell(self._settings.robot, self._settings.mount).robot.stamp
        if recorded != (ours := inner.settings.cell.robot.stamp):
            raise InputError(
                f"the demonstrations are of {recorded}, the environment has {ours}: make some of its own"
            )

    @property
    def ways(self) -> int:
        """Number of demonstrations."""
        return len(self.states)

    def options(self, way: int, share: float) -> Fields:
        """Return the state of a reset at a share of a demonstration."""
        states = self.states[way]
        return {"state": states[min(int(share * len(states)), len(states) - 1)]}

    def _follow(self, env: LiftEnv, demo: Demonstration) -> list[EpisodeState]:
        """Return the states up to success, every fourth step; none where it is not reached."""
        states: list[EpisodeState] = []
        for step, (_, result) in enumerate(self._play(env, demo)):
            if result[4]["is_success"]:
                return states
            if step % 4 == 0:
                states.append(_lean(env, states[-1].view if states else None))
        return []

    def _play(self, env: LiftEnv, demo: Demonstration) -> Iterator[tuple[Single | None, tuple[Any, ...]]]:
        """Yield each action and what `step` returned along a demonstration; first None and the reset."""
        target = demo.about["target"]
        if target not in env.settings.objects:
            return
        pose = self._pose(demo)
        pose[2] += 0.002  # m: what lies has sunk in too deep to ask for
        where: Fields = {"object": target, "object_pose": pose}
        if isinstance(env, PlaceEnv):
            if "object_pose" not in demo.observations:
                raise InputError(
                    "demonstrations of Place say where they end in obs_mode 'state': these are of cameras"
                )
            where["goal"] = [*demo.observations["object_pose"][-1, :3], 1.0]  # held where it is at last
        first, info = env.reset(seed=demo.about["scene_seed"], options=where)
        yield None, (first, 0.0, False, False, {**info, "is_success": False})
        path = demo.observations["joint_targets"].astype(float)
        yield from follow_set_points(env, path)

    def transitions(self, env: LiftEnv) -> Iterator[tuple[Any, Any, Single, float, bool]]:
        """Yield the steps of all demonstrations that succeed in an environment, followed in its own actions.

        Args:
            env: of ours, single, without wrappers; its episode is lost.

        Yields:
            Observation, the next one, action, reward, and whether the episode terminated.

        Raises:
            InputError: for actions that set-points of joints are none of, or as `attach`.
        """
        if env.settings.control_mode in GRASP_MODES:
            raise InputError(
                f"demonstrations are set-points of joints, which control_mode {env.settings.control_mode!r} has no "
                f"actions for: valid are {', '.join(DIRECT_MODES)}"
            )
        self._check(env)
        for demo in self._demos:
            steps, before = list[Any](), None
            for action, (after, reward, terminated, _, info) in self._play(env, demo):
                if action is not None:
                    steps.append((before, after, action, float(reward), terminated))
                before = after
                if info["is_success"]:
                    yield from steps
                    break

    def _pose(self, demo: Demonstration) -> Array:
        """Return the initial pose (7,) of the object of a demonstration."""
        if "object_pose" in demo.observations:
            return demo.observations["object_pose"][0].astype(float)
        scene = self._settings.env_arguments | {"obs_mode": "state", "objects": [demo.about["target"]]}
        seen, _ = gym.make(ENV_ID, **scene, disable_env_checker=True).reset(seed=demo.about["scene_seed"])
        return np.array(seen["object_pose"], dtype=float)


def _followed(demo: Demonstration) -> Demonstration:
    """Return a demonstration with only the observations that replaying it takes."""
    seen = {key: array for key, array in demo.observations.items() if key in ("joint_targets", "object_pose")}
    return replace(demo, observations=seen, once={})


def _lean(env: LiftEnv, before: CameraViews | None = None) -> EpisodeState:
    """Return the state of an environment; its view is shared with `before` where the cameras have not looked since."""
    state = env.get_state()
    if env.settings.observe == "step":
        return replace(state, view=CameraViews())
    if before and all(np.array_equal(state.view.seen[key], values) for key, values in before.seen.items()):
        return replace(state, view=before)
    return state
