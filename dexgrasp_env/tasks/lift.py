"""DexGrasp/Lift-v0."""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.robot.limits import HOME
from dexgrasp_env.scene.build import build_scene
from dexgrasp_env.scene.constants import CONTROL_PERIOD, FRICTION
from dexgrasp_env.sensing.cameras import default_cameras
from dexgrasp_env.tasks import control
from dexgrasp_env.tasks.observations import object_observation, observation_space, robot_observation
from dexgrasp_env.tasks.randomisation import Variation
from dexgrasp_env.tasks.rewards import dense_reward, reward_terms, sparse_reward
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import BAD_NUMBERS, PalmJacobian, Simulation
from dexgrasp_env.tasks.state import LiftState
from dexgrasp_env.tasks.success import Progress, advance, diverged, object_lost
from dexgrasp_env.tasks.views import Views

_RESET_OPTIONS = ("object", "object_pose")


@lru_cache(maxsize=64)
def compiled_scene(model: ObjectModel, mount: str) -> mujoco.MjModel:
    """Compile the scene of an object once; callers copy it before they write to it."""
    return build_scene(model, mount=mount, cameras=default_cameras())


class LiftEnv(gym.Env[dict[str, NDArray[Any]], NDArray[np.float32]], EzPickle):
    """Pick an object up from a table with an arm and a hand, and hold it.

    ## Description

    A Franka Emika Panda with an Allegro hand stands at a table. One object lies on it. The task is solved when the
    object's lowest point has been at least 10 cm above the table for the last 3 s and nothing but the hand has touched
    it meanwhile. Control runs at 20 Hz, physics at 500 Hz. Quantities are in metres, radians, kilograms and newtons, in
    the robot base frame: x forward, z up, table top at z = 0.

    ## Action Space

    A `Box(-1, 1, (n,), float32)`; entries outside are clipped, NaN and wrong shapes raise `InputError`. Actions become
    set-points of the 23 joint servos, which move evenly within the control step, at most at the joints' velocity
    limits. Joints are in the order panda_joint1-7, then index, middle, ring and thumb with four each.

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
    | `cloud` | (1024, 3) | float32 | `pointcloud` | m, points of the object |
    | `cloud_normals` | (1024, 3) | float32 | `pointcloud` | unit normals out of the object |
    | `cloud_mask` | (1024,) | int8 | `pointcloud` | 1 where a point counts |
    | `table_plane` | (5,) | float32 | `pointcloud` | normal, offset m and RMS m of the table as seen |
    | `depth` | (4, 120, 160) | float32 | `depth`, `rgbd` | m along the optical axis, 0 where nothing was measured |
    | `rgb` | (4, 120, 160, 3) | uint8 | `rgbd` | colours |

    `info` has at every step `is_success`, `is_stable` (less than 2.5 cm and 15 deg of motion in the hand's frame since
    the object left the table), `stage` (untouched, touched, lifted, dropped, held), `failure`, `object`,
    `object_height`, `object_slip`, `object_tilt`, `held_seconds`, `mujoco_warnings`, and after a step `reward_terms`.
    With cameras it has `perception_failure`, `perception_T_world_camera` and `perception_intrinsics`.

    ## Rewards

    `sparse` is 1 while the task is solved, else 0. `dense` is in [0, 1], the weighted sum of

    | Term | Weight | Meaning |
    | --- | --- | --- |
    | `reach` | 0.2 | thumb, index and middle tips within 2 cm of the object's box, falling off over 30 cm |
    | `contact` | 0.2 | the thumb and a finger opposite it press, full at 1 N each |
    | `lift` | 0.3 | height of the lowest point over 10 cm while the hand touches the object |
    | `hold` | 0.3 | time held over 3 s |

    ## Starting State

    The arm at its ready posture, the hand open. An object of `objects` is drawn, then its rest pose by probability, its
    place (x in 0.42-0.60, y in +-0.20) and its turn about the vertical; it settles for 0.2 s. Objects that the
    catalogue presents in one pose always lie in that.
    `reset(options={"object": NAME, "object_pose": [x, y, z, qw, qx, qy, qz]})` sets them.

    ## Episode End

    Terminates when the object leaves the workspace (`failure` is `object_lost`) or numbers go wrong
    (`simulation_diverged`, with reward 0). Truncates after 300 steps, 15 s. Success ends nothing: the object is to stay
    up.

    ## Arguments

    | Argument | Default | Valid |
    | --- | --- | --- |
    | `objects` | `'ycb6'` | name, set (`ycb6`, `seen`, `familiar`, `novel`, `all20`), mesh file, or a list of these |
    | `obs_mode` | `'state'` | `state`, `pointcloud`, `depth`, `rgbd` |
    | `control_mode` | `'joint_delta'` | `joint_position`, `joint_delta`, `ee_delta` |
    | `reward_mode` | `'dense'` | `dense`, `sparse` |
    | `mount` | `'palm_normal'` | `palm_normal`, `fingers_along`: how the hand sits on the flange |
    | `friction` | `0.7` | sliding friction coefficient of every contact, above 0 and up to 2 |
    | `object_pose` | `None` | ranges `x`, `y`, `yaw` and `rest_pose` (`any`, `likely`, a number) |
    | `randomisation` | `None` | ranges `mass` and `size` (factors) and `friction` (coefficient), drawn at reset |
    | `sensor` | `'realistic'` | `realistic`, `none`, or settings of `SensorModel` |
    | `observe` | `'step'` | `step`; `reset`: cameras look once, the view is repeated |
    | `mesh_scale` | `1.0` | factor from a mesh file's unit to metres |
    | `mesh_mass` | `None` | kg of a mesh file's object; None for 400 kg/m3 |
    | `render_mode` | `None` | `human`, `rgb_array`, `depth_array` |
    | `render_size` | `(480, 640)` | rows and columns of pictures |

    ## Contact model, frozen as v0

    | Setting | Value |
    | --- | --- |
    | timestep | 0.002 s, implicitfast, tolerance 1e-8 |
    | cone | elliptic, impratio 100, condim 3; table against object condim 6 |
    | friction | 0.7 sliding everywhere; 0.0002 m rolling between table and object |
    | fingertip against object | solref 0.02 1, solimp 0.9 0.95 0.001 0.5 2, solreffriction 0.004 1 |

    Slip begins at mu N in every direction. Nothing welds, attracts or sticks the object to the hand.

    ## Version History

    * v0: first version.
    """

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
        mount: str = "palm_normal",
        friction: float = FRICTION,
        object_pose: Mapping[str, Any] | None = None,
        randomisation: Mapping[str, Any] | None = None,
        sensor: Mapping[str, Any] | str = "realistic",
        observe: str = "step",
        mesh_scale: float = 1.0,
        mesh_mass: float | None = None,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (480, 640),
    ) -> None:
        EzPickle.__init__(
            self, objects, obs_mode, control_mode, reward_mode, mount, friction, object_pose, randomisation, sensor,
            observe, mesh_scale, mesh_mass, render_mode, render_size,
        )  # fmt: skip
        self.settings = LiftSettings.of(
            objects, object_pose, randomisation, obs_mode=obs_mode, control_mode=control_mode, reward_mode=reward_mode,
            mount=mount, friction=friction, observe=observe, mesh_scale=mesh_scale, mesh_mass=mesh_mass,
            render_mode=render_mode,
        )  # fmt: skip
        self.render_mode = render_mode
        self._simulations = {
            target: Simulation.of(model, compiled_scene(model, mount))
            for target, model in self.settings.load_objects().items()
        }
        self._views = Views(obs_mode, observe, sensor, render_size)
        self.action_space = spaces.Box(-1.0, 1.0, (control.ACTION_SIZE[control_mode],), np.float32)
        self.observation_space = observation_space(obs_mode, self._views.image_shape)  # type: ignore[assignment]
        self._simulation = next(iter(self._simulations.values()))
        self._jacobian = PalmJacobian(self._simulation.base)
        self._progress = Progress.start()
        self._over = True

    @property
    def simulation(self) -> Simulation:
        """The simulation of the episode, for pictures and evaluation; agents see observations only."""
        return self._simulation

    @property
    def progress(self) -> Progress:
        """What the episode has achieved so far."""
        return self._progress

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Start an episode.

        Args:
            seed: of every draw of this and the following episodes.
            options: `object` names one of the environment's objects; `object_pose` is (7,) position m and quaternion
                wxyz of the object in the robot base frame.

        Raises:
            InputError: for an unknown option, object or a malformed pose.
        """
        super().reset(seed=seed)
        options = _check_options(options, list(self._simulations))
        names = list(self._simulations)
        drawn = names[int(self.np_random.integers(len(names)))]
        self._simulation = simulation = self._simulations[options.get("object", drawn)]
        variation = self.settings.randomisation.sample(self.np_random, self.settings.friction)
        pose = self._sample_pose(simulation.object, variation)
        simulation.reset(options.get("object_pose", pose), variation)
        self._progress = Progress.start()
        self._over = False
        observation, views_info = self._observe(simulation.state, at_reset=True)
        if self.render_mode == "human":
            self.render()
        return observation, self._info(self._simulation.warnings) | views_info

    def _sample_pose(self, model: ObjectModel, variation: Variation) -> NDArray[np.float64]:
        pose = self.settings.object_pose.sample(model, self.np_random)
        pose[2] *= variation.size
        return pose

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[dict[str, NDArray[Any]], float, bool, bool, dict[str, Any]]:
        """Advance 50 ms.

        Raises:
            InputError: if the action has the wrong shape or is not finite, or no episode is running.
        """
        if self._over:
            raise InputError("step() called without a running episode: call reset() first")
        simulation = self._simulation
        simulation.step(self._next_targets(self._check_action(action)))
        state = simulation.state
        self._progress = advance(self._progress, state, simulation.constants)
        warnings = simulation.warnings
        failure = self._failure(state, warnings)
        terms = reward_terms(state, self._progress, simulation.constants)
        dense = self.settings.reward_mode == "dense"
        reward = float(dense_reward(terms) if dense else sparse_reward(self._progress))
        self._over = failure is not None
        if failure == "simulation_diverged":
            reward, terms = 0.0, dict.fromkeys(terms, np.zeros(()))
        observation, views_info = self._observe(state, at_reset=False)
        if self.render_mode == "human":
            self.render()
        info = self._info(warnings, failure) | views_info
        info["reward_terms"] = {name: float(value) for name, value in terms.items()}
        return observation, reward, self._over, False, info

    def _check_action(self, action: NDArray[np.float32]) -> NDArray[np.float64]:
        action = np.asarray(action, dtype=float)
        if action.shape != self.action_space.shape:
            raise InputError(f"action has shape {action.shape}: valid is {self.action_space.shape}")
        if not math.isfinite(float(action.sum())):  # one bad entry makes the sum bad
            raise InputError(
                f"action has NaN or infinite entries at {np.flatnonzero(~np.isfinite(action)).tolist()}"
            )
        return np.minimum(np.maximum(action, -1.0), 1.0)

    def _next_targets(self, action: NDArray[np.float64]) -> NDArray[np.float64]:
        targets = self._simulation.targets
        if self.settings.control_mode == "joint_position":
            return control.joint_position(action, targets)
        if self.settings.control_mode == "joint_delta":
            return control.joint_delta(action, targets)
        return control.ee_delta(action, targets, self._jacobian, HOME[:7])

    def _failure(self, state: LiftState, warnings: list[str]) -> str | None:
        if bool(diverged(state)) or (warnings and not BAD_NUMBERS.isdisjoint(warnings)):
            return "simulation_diverged"
        return "object_lost" if bool(object_lost(state)) else None

    def _observe(self, state: LiftState, at_reset: bool) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        simulation = self._simulation
        observation: dict[str, NDArray[Any]] = dict(robot_observation(state))
        if self.settings.obs_mode == "state":
            observation |= object_observation(state, self._progress, simulation.constants)
        views, info = self._views.observe(simulation, self.np_random, at_reset)
        return observation | views, info

    def _info(self, warnings: list[str], failure: str | None = None) -> dict[str, Any]:
        progress, simulation = self._progress, self._simulation
        return {
            "is_success": bool(progress.is_success),
            "is_stable": bool(progress.is_stable),
            "stage": str(progress.stage),
            "failure": failure,
            "object": simulation.object.name,
            "object_height": float(progress.height),
            "object_slip": float(progress.slip),
            "object_tilt": float(progress.tilt),
            "held_seconds": float(progress.held_steps * CONTROL_PERIOD),
            "mujoco_warnings": warnings,
        }

    def render(self) -> Any:
        """Return a picture (`rgb_array`: (H, W, 3) uint8; `depth_array`: (H, W) float32 m), or show it (`human`)."""
        return self._views.render(self.render_mode, self._simulation)

    def close(self) -> None:
        """Free what rendering holds."""
        self._views.close()


def _check_options(options: dict[str, Any] | None, objects: list[str]) -> dict[str, Any]:
    options = dict(options or {})
    for key in options:
        if key not in _RESET_OPTIONS:
            raise unknown_name("reset option", key, _RESET_OPTIONS)
    if "object" in options and options["object"] not in objects:
        raise unknown_name("object", options["object"], objects)
    if "object_pose" in options:
        pose = np.asarray(options["object_pose"], dtype=float)
        if pose.shape != (7,) or not np.isfinite(pose).all() or np.linalg.norm(pose[3:]) < 1e-6:
            raise InputError("object_pose must be 7 finite numbers: position in metres and a quaternion wxyz")
        options["object_pose"] = np.concatenate([pose[:3], pose[3:] / np.linalg.norm(pose[3:])])
    return options
