"""DexGrasp/Lift-v2, and v1."""

import copy
import inspect
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Given
from dexgrasp_env.scene.constants import CONTROL_PERIOD, CONTROL_STEPS
from dexgrasp_env.tasks.control import ActionSpace, check_actions
from dexgrasp_env.tasks.episodes import Episodes, EpisodeState, Starts
from dexgrasp_env.tasks.observations import OBS_SUMS
from dexgrasp_env.tasks.physics import give_physics
from dexgrasp_env.tasks.records import TOLD
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import Simulation
from dexgrasp_env.tasks.views import Views

_ONLY = slice(None)
_FAILURE = TOLD.index("failure")
NO_WARNINGS = np.zeros(1, np.int64)


class LiftEnv(gym.Env[dict[str, NDArray[Any]], NDArray[np.float32]], EzPickle):
    """Pick an object up from a table with an arm and a hand, and hold it.

    ## Description

    A robot stands at a table, a Franka Emika Panda with an Allegro hand where `robot` names no other. One object lies
    on it. The task is solved when the object's lowest point has been at least 10 cm above the table for the last 3 s,
    nothing but the hand has touched it meanwhile, and it is grasped: at the end and for 90 % of that time the thumb and
    the index, middle or ring finger press it with at least 0.5 N each, from opposite sides (more than 90 deg between
    the forces). Control runs at 20 Hz, physics at 500 Hz. Quantities are in metres, radians, kilograms and newtons, in
    the world frame: x forward, z up, table top at z = 0.

    ## Action Space

    A `Box(-1, 1, (n,), float32)`; entries outside are clipped, NaN and wrong shapes raise `InputError`. Actions become
    set-points of the 23 joint servos, which move evenly within the control step, at most at the joints' velocity
    limits. Joints are in the order panda_joint1-7, then index, middle, ring and thumb with four each. Of another robot
    with n joints, a of them the arm's, and F fingers, 23 stands for n, 22 for 6 + n - a and 12 for 3 F, in the order of
    its file: `dexgrasp list envs --robot FILE` says which.

    | control_mode | n | Entries | Meaning |
    | --- | --- | --- | --- |
    | `joint_position` | 23 | 0-22 | set-points; -1 and 1 are the ends of the joint range |
    | `joint_delta` | 23 | 0-22 | change of the set-points; 1 is the velocity limit times 50 ms |
    | `ee_delta` | 22 | 0-2 | translation of the palm; 1 is 25 mm |
    | | | 3-5 | rotation vector of the palm; 1 is 0.125 rad |
    | | | 6-21 | set-points of the hand's joints; -1 and 1 are the ends of the range |

    ## Observation Space

    A `Dict`. Every mode has what the robot knows of itself:

    | Key | Shape | Type | Meaning |
    | --- | --- | --- | --- |
    | `joint_positions` | (23,) | float32 | rad |
    | `joint_velocities` | (23,) | float32 | rad/s |
    | `joint_targets` | (23,) | float32 | rad, set-points of the servos |
    | `fingertip_positions` | (12,) | float32 | m, centres of the tips: index, middle, ring, thumb |
    | `palm_pose` | (7,) | float32 | position m and quaternion wxyz of the palm frame |

    `state` adds what no camera tells, `pointcloud`, `depth` and `rgbd` what four simulated depth cameras see:

    | Key | Shape | Type | obs_mode | Meaning |
    | --- | --- | --- | --- | --- |
    | `object_pose` | (7,) | float32 | `state` | position of the centre of mass m and quaternion wxyz |
    | `object_velocity` | (6,) | float32 | `state` | m/s, and rad/s in the object frame |
    | `object_size` | (3,) | float32 | `state` | m, box of the object in its own frame |
    | `object_mass` | (1,) | float32 | `state` | kg |
    | `fingertip_forces` | (12,) | float32 | `state` | N, contact force between each tip and the object |
    | `progress` | (2,) | float32 | `state` | m, lowest point above the table; share of the 3 s held, 0 to 1 |
    | `variation` | (6,) | float32 | `state` | mass factor, friction, size factor, gain factor, latency s, noise rad |
    | `cloud` | (1024, 3) | float32 | `pointcloud` | m, points of the object |
    | `cloud_normals` | (1024, 3) | float32 | `pointcloud` | unit normals out of the object |
    | `cloud_mask` | (1024,) | int8 | `pointcloud` | 1 where a point counts |
    | `table_plane` | (5,) | float32 | `pointcloud` | normal, offset m and RMS m of the table as seen |
    | `depth` | (4, 120, 160) | float32 | `depth`, `rgbd` | m along the optical axis, 0 where nothing was measured |
    | `rgb` | (4, 120, 160, 3) | uint8 | `rgbd` | colours |

    With fewer `views` the first axis of the images is as long as they are many. Keys are in alphabetical order. `info`
    has at reset and at every step, always of one type each: `is_success`, `is_grasped`, `is_stable` (less than 2.5 cm
    and 15 deg of motion in the hand's frame since the object left the table), `stage` (untouched, touched, lifted,
    dropped, held), `failure` (empty while there is none), `object`, `object_height` m, `object_slip` m, `object_tilt`
    rad, `object_shift` m (in the palm's frame since the disturbance began), `held_seconds`, `disturbance` (none,
    before, running, over), `variation` (what was drawn), `mujoco_warnings` (names with spaces between), `reward_terms`.
    With cameras it has `perception_failure`, `perception_T_world_camera` (as calibrated) and `perception_intrinsics`.

    ## Rewards

    `sparse` is 1 while the task is solved, else 0. `dense` is what the weighted sum of these terms, each in [0, 1], has
    gained in the control step, and what it has lost is taken away:

    | Term | Weight | Meaning |
    | --- | --- | --- |
    | `reach` | 5.0 | thumb, index and middle tips within 2 cm of the object's box, 0 from 62 cm |
    | `close` | 10.0 | tips within 2 mm of the box, falling off over 6 cm, with its inside between thumb and fingers |
    | `contact` | 5.0 | thumb and fingers press from opposite sides, full at 0.5 N |
    | `squeeze` | 5.0 | the lesser of the two forces over what bears the weight by friction |
    | `lift` | 15.0 | height of the lowest point over 10 cm, times `contact` |
    | `hold` | 10.0 | time held in a grasp, of the last 3 s; a disturbance must be over |
    | `success` | 50.0 | 1 from the first success on |

    The return of an episode is therefore the sum at its end less that at its start: at most 50 without success,
    whatever is done and for however long; at least 50 with it, about 100 where the object is still held at the end. An
    episode that fails (see below) loses all but `success`. `reward_weights` replaces weights, by term.

    ## Starting State

    The arm at its ready posture, the hand open. An object of `objects` is drawn, then its rest pose by probability, its
    place (x in 0.42-0.60, y in +-0.20) and its turn about the vertical; it settles for 0.2 s. Objects that the
    catalogue presents in one pose always lie in that.
    `reset(options={"object": NAME, "object_pose": [x, y, z, qw, qx, qy, qz]})` sets them; the pose must be over the
    table, not inside it, free of the robot and in reach. Observation and info of the reset show this state.

    ## Episode End

    Terminates when the object leaves the workspace (`failure` is `object_lost`) or numbers go wrong
    (`simulation_diverged`). Truncates after 300 steps, 15 s. Success ends nothing: the object is to stay up. A
    `disturbance` begins once the object has been held for 1 s, and success is then the 3 s hold after its end with the
    object moved at most 6 cm in the palm's frame; it takes `disturbance_steps` (80 pushed, 40 shaken), by which the
    time limit should grow: `LiftPushed-v1` has 380, elsewhere pass `max_episode_steps`; with the usual 300 a warning
    says what.

    ## States

    `get_state()` returns everything the episode's future depends on, `set_state(state)` goes on from there bit for bit,
    also in another environment of the same settings; `copy.deepcopy` and `pickle` keep the episode as well. `observe()`
    returns observation and info of the present. `reset(options={"state": state})` begins an episode there, with as much
    time as any. Gymnasium's `TimeLimit` wrapper keeps a count of its own, which `set_state` does not touch; the vector
    environment's `set_state` restores its count. `model`, `data` and `dt` are MuJoCo's.

    ## Arguments

    | Argument | Default | Valid |
    | --- | --- | --- |
    | `objects` | `'ycb6'` | name, set (`ycb6`, `seen`, `familiar`, `novel`, `all20`), mesh file, or a list of these |
    | `obs_mode` | `'state'` | `state`, `pointcloud`, `depth`, `rgbd`, or the state beside one: `state+pointcloud` ... |
    | `control_mode` | `'joint_delta'` | `joint_position`, `joint_delta`, `ee_delta` |
    | `reward_mode` | `'dense'` | `dense`, `sparse` |
    | `robot` | `None` | a cell, a robot, or the path of a file of either; None: the simulated cell |
    | `mount` | `None` | `palm_normal`, `fingers_along`: how the hand sits on the flange; None: the robot's own |
    | `friction` | `None` | sliding friction of every contact, above 0 and up to 2; None: 0.7, or a set file's |
    | `mass` | `1.0` | factor on the object's mass, above 0 and up to 100 |
    | `presentation` | `'rest'` | `rest`; `upright`: standing as built where that is stable, else at rest |
    | `disturbance` | `None` | `none`, `pushed`, `shaken`, or `kind` and `size` (of the weight; of the shaking) |
    | `object_pose` | `None` | ranges `x`, `y`, `yaw` and `rest_pose` (`any`, `likely`, a number) |
    | `randomisation` | `None` | ranges of `mass`, `size`, `gain` (factors), `friction`, `latency` s, `joint_noise` |
    | `views` | `4` | names of the cameras that look, or how many of them to draw at reset |
    | `calibration` | `None` | `position` m and `rotation` rad: one rigid error of all cameras, drawn at reset |
    | `sensor` | `'realistic'` | `realistic`, `none`, or settings of `SensorModel` |
    | `observe` | `'step'` | `step`; `reset`: cameras look once; `clear`: and whenever the arm is home |
    | `mesh_scale` | `1.0` | factor from a mesh file's unit to metres |
    | `mesh_mass` | `None` | kg of a mesh file's object; None for 400 kg/m3 |
    | `render_mode` | `None` | `human`, `rgb_array`, `depth_array` |
    | `render_size` | `(480, 640)` | rows and columns of pictures |
    | `render_camera` | `'front'` | `front`; `grasp`: follows the hand, close by; or one of the depth cameras |
    | `version` | `2` | `2`, or `1`: the dense reward of version 1 |
    | `reward_weights` | `None` | weights by term, from 0 on; terms that are not named keep theirs |
    | `frame_skip` | `25` | physics steps of a control step, 5 to 125; what lasts seconds still does |
    | `action_scale` | `1.0` | factor, above 0 and up to 1, on what 1 means in actions that are changes |
    | `backend` | `'mujoco'` | `mujoco`; `warp`: mujoco_warp, the extra `gpu`; see the vector environment |
    | `device` | `None` | of `warp`: `cuda:0`, `cuda:1`, ..., `cpu`; None: a GPU where there is one |

    ## Version History

    * v2: a dense reward that leads to a grasp and that nothing but success earns in full; physics and success are v1's.
    * v1: deprecated for its dense reward: the sum of `reach` (0.2), `contact` (0.2: thumb and a finger press, full at
      1 N each), `lift` (0.3) and `hold` (0.3) at every step, of which much is earned by hovering.
    """

    episodes_type = Episodes
    settings_type: type[LiftSettings] = LiftSettings
    obs_modes: tuple[str, ...] = OBS_SUMS
    metadata = {  # noqa: RUF012  (as Gymnasium has it)
        "render_modes": ["human", "rgb_array", "depth_array"],
        "render_fps": round(1 / CONTROL_PERIOD),
    }

    def __init__(
        self,
        objects: str | Sequence[str] = "ycb6",
        obs_mode: str = "state",
        control_mode: str = "joint_delta",
        reward_mode: str = "dense",
        robot: Given = None,
        mount: str | None = None,
        friction: float | None = None,
        mass: float = 1.0,
        presentation: str = "rest",
        disturbance: Mapping[str, Any] | str | None = None,
        object_pose: Mapping[str, Any] | None = None,
        randomisation: Mapping[str, Any] | None = None,
        views: Sequence[str] | int = 4,
        calibration: Mapping[str, Any] | None = None,
        sensor: Mapping[str, Any] | str = "realistic",
        observe: str = "step",
        mesh_scale: float = 1.0,
        mesh_mass: float | None = None,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (480, 640),
        render_camera: str = "front",
        version: int = 2,
        reward_weights: Mapping[str, float] | None = None,
        frame_skip: int = CONTROL_STEPS,
        action_scale: float = 1.0,
        backend: str = "mujoco",
        device: str | None = None,
    ) -> None:
        given = {key: value for key, value in locals().items() if key not in ("self", "__class__")}
        EzPickle.__init__(self, **given)
        self._make(given)

    def _make(self, given: dict[str, Any]) -> None:
        self.settings = self.settings_type.of(**given)
        self._views = Views(self.settings)
        self.render_mode = self.settings.render_mode
        self.metadata = {**self.metadata, "render_fps": round(1 / self.settings.period)}
        self._episodes = self.episodes_type(self.settings, self._views, 1)
        robot = self.settings.cell.robot
        self.action_space = ActionSpace(self.settings.control_mode, robot)  # type: ignore[assignment]
        self.observation_space = self._episodes.observation_space()  # type: ignore[assignment]
        self._simulation = next(iter(self._episodes.simulations.values()))
        give_physics(self._episodes)
        self._over = True

    @classmethod
    def arguments(cls, **given: Any) -> dict[str, Any]:
        """Return all arguments: those given, and the defaults of the others."""
        parameters = inspect.signature(LiftEnv.__init__).parameters
        return {name: parameter.default for name, parameter in parameters.items() if name != "self"} | given

    @property
    def simulation(self) -> Simulation:
        """The simulation of the episode, for pictures and evaluation; agents see observations only."""
        return self._simulation

    @property
    def target(self) -> str:
        """The object of the episode, as `objects` names it: a name, or the path as it was given."""
        return self._episodes.slots[0].target

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model of the episode, with its variation."""
        return self._simulation.model

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's live data: the full integration state after every reset and step; `ctrl` the last set-points."""
        return self._simulation.data

    @property
    def dt(self) -> float:
        """Seconds of a control step."""
        return self.settings.period

    @property
    def targets(self) -> NDArray[np.float64]:
        """Set-points of the servos as the agent has them, (n,) rad."""
        return self._episodes.commands[0, 0].copy()

    @property
    def disturbance_steps(self) -> int:
        """Control steps that the disturbance takes: what a time limit should allow for."""
        return self.settings.disturbance_steps

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Start an episode.

        Args:
            seed: of every draw of this and the following episodes.
            options: `object` names one of the environment's objects; `object_pose` is (7,) position m and quaternion
                wxyz of the object in the world frame. Or `state`, of `get_state`, where the episode is to begin.

        Raises:
            InputError: for an unknown option or object, or a pose that cannot be.
        """
        super().reset(seed=seed)
        # The limit is a wrapper's: where the last episode ended shows it.
        self.settings.disturbance.warn_of_limit(
            int(self._episodes.records["elapsed"][0]), self.settings.frame_skip
        )
        self._over = True  # options may be refused
        self._simulation = self._episodes.begin(0, self.np_random, options)
        slot = self._episodes.slots[0]
        observation = self._conclude(0, judge=not slot.resumed)
        self._over = False
        return self._look(observation, at_reset=not (slot.resumed and slot.view.seen))

    def observe(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return observation and info of the present: those of the last reset or step, or of the state that was set.

        Nothing moves, and no camera looks again; where joint sensors are noisy, their noise is drawn anew.

        Raises:
            InputError: before the first reset.
        """
        self.get_state()
        rng = copy.deepcopy(self.np_random)
        observation = self._episodes.conclude(
            _ONLY, self._simulation.moment, NO_WARNINGS, [rng], alone=True, judge=False
        )
        seen = self._episodes.slots[0].view
        observation = dict(sorted((observation | copy.deepcopy(seen.seen)).items()))
        return observation, self._episodes.info(0) | copy.deepcopy(seen.info)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[dict[str, NDArray[Any]], float, bool, bool, dict[str, Any]]:
        """Advance 50 ms.

        Raises:
            InputError: if the action has the wrong shape or is not finite, or no episode is running.
        """
        return self.finish_step(self._simulation.step(self.start_step(action)))

    def twin(self) -> "LiftEnv":
        """Return another environment of the same settings, without an episode."""
        kwargs: dict[str, Any] = self._ezpickle_kwargs
        return type(self)(**kwargs)

    def start_from(self, starts: Starts | None) -> None:
        """Have resets that are given no options take those that `starts` gives."""
        self._episodes.starts = starts

    def start_step(self, action: NDArray[np.float32]) -> NDArray[np.float64]:
        """Do the first part of a step, before the physics: move the set-points, and push what is to be pushed.

        Args:
            action: as for `step`.

        Returns:
            Set-points of the physics steps (1, frame_skip, n) rad, for `simulation.step`.

        Raises:
            InputError: as `step`.
        """
        if self._over:
            raise InputError("step() called without a running episode: call reset() first")
        rows, push = self._episodes.set_points(_ONLY, check_actions(action, self.action_space.shape)[None])
        if self.settings.disturbance.kind == "pushed":
            self._simulation.data.xfrc_applied[self._simulation.body, :3] = push[0]
        return rows

    def finish_step(self, bits: int) -> tuple[dict[str, NDArray[Any]], float, bool, bool, dict[str, Any]]:
        """Do the last part of a step, after the physics: judge and observe.

        Args:
            bits: the physics' warnings, as `simulation.step` returns them.

        Returns:
            What `step` returns.
        """
        observation, episodes = self._conclude(bits), self._episodes
        self._over = bool(episodes.told[0, _FAILURE])
        observation, info = self._look(observation, at_reset=False)
        return observation, float(episodes.rewards[0]), self._over, False, info

    def _conclude(self, bits: int, judge: bool = True) -> dict[str, NDArray[Any]]:
        warnings = np.array([bits]) if bits else NO_WARNINGS
        rngs = [self.np_random]
        return self._episodes.conclude(
            _ONLY, self._simulation.moment, warnings, rngs, alone=True, judge=judge
        )

    def _look(
        self, observation: dict[str, NDArray[Any]], at_reset: bool
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        episodes, simulation = self._episodes, self._simulation
        info = episodes.info(0)
        if self.settings.obs_mode != "state":
            looks = simulation if at_reset or self._views.due(simulation.data.qpos) else None
            views, seen = self._views.observe(episodes.slots[0].view, looks, self.np_random, at_reset)
            observation = dict(sorted((observation | views).items()))
            info |= seen
        if self.render_mode == "human":
            self.render()
        return observation, info

    def get_state(self) -> EpisodeState:
        """Return everything that the running episode's future depends on.

        Raises:
            InputError: before the first reset.
        """
        if not self._episodes.slots[0].target:
            raise InputError("get_state() called without an episode: call reset() first")
        physics, sensors = self._simulation.get_state(), self._simulation.data.sensordata
        return self._episodes.get_state(0, physics, sensors, self.np_random)

    def set_state(self, state: EpisodeState) -> None:
        """Go on from a state, of this environment or of another with the same settings.

        Raises:
            InputError: if the state is of an object that is not among this environment's, or of other settings.
        """
        self._simulation = self._episodes.set_state(0, state, self.np_random)
        self._over = bool(state.record["failure"])

    def __getstate__(self) -> dict[str, Any]:
        """The constructor's arguments and the episode: compiled models and windows are made anew."""
        episode = self.get_state() if self._episodes.slots[0].target else None
        return {
            "made": EzPickle.__getstate__(self),
            "episode": episode,
            "spec": self.spec,
            "seed": self._np_random_seed,
            "starts": self._episodes.starts,
        }

    def __setstate__(self, kept: dict[str, Any]) -> None:
        EzPickle.__setstate__(self, kept["made"])
        self.spec = kept["spec"]
        self._episodes.starts = kept["starts"]
        if kept["episode"] is not None:
            self.set_state(kept["episode"])
            self._np_random_seed = kept["seed"]

    def render(self) -> Any:
        """Return a picture (`rgb_array`: (H, W, 3) uint8; `depth_array`: (H, W) float32 m), or show it (`human`)."""
        return self._views.render(self.render_mode, self._simulation)

    def close(self) -> None:
        """Free what rendering holds."""
        self._views.close()
