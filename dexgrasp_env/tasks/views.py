"""Camera observations, and pictures for people."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Array, Arrays, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.pipeline import COUNT
from dexgrasp_env.rendering import ColourCameras, make_renderer, render, show_camera
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.sensing.perception import Perception
from dexgrasp_env.tasks.constants import AROUND_POINTS
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import Simulation


@dataclass
class CameraViews:
    """Cameras of one episode, and their last observation.

    Attributes:
        cameras: names of those that look.
        believed: where the calibration believes them to be.
        seen: the camera part of the last observation.
        info: and of its info.
        age: s since it was taken.
    """

    cameras: tuple[str, ...] = ()
    believed: tuple[Camera, ...] = ()
    seen: Arrays = field(default_factory=dict)
    info: Fields = field(default_factory=dict)
    age: float = 0.0


class CameraObserver:
    """Camera observations of the environment; builds nothing until a mode asks for it."""

    def __init__(self, settings: LiftSettings, number: int = 1) -> None:
        """Prepare the views of so many episodes side by side."""
        self._settings = settings
        self._most = min(number, 32)  # contexts of GL, of a kind: drivers run out of them at some hundreds
        self._perceptions = WeakKeyDictionary[Simulation, tuple[Any, Perception]]()
        self._contexts: dict[tuple[str, Simulation, float], Any] = {}
        self._cameras = settings.cell.make_cameras()
        intrinsics = self._cameras[0].intrinsics
        number = settings.views if isinstance(settings.views, int) else len(settings.views)
        self.image_shape = (number, intrinsics.height, intrinsics.width)

    def observe(
        self, view: CameraViews, qpos: Array, scene: Callable[[], Simulation], rng: Generator, at_reset: bool
    ) -> None:
        """Take images when they are due; in between the last ones stay.

        Args:
            view: of the episode; kept up to date.
            qpos: present positions (n + 7,).
            scene: returns the scene with these in `data`; asked where cameras look.
            rng: of the episode.
            at_reset: whether cameras are drawn and calibrated anew.
        """
        if at_reset:
            view.cameras = self._choose(rng)
        view.age += self._settings.period * self._settings.hold
        if at_reset or self._due(qpos, view.age):
            view.age = 0.0
            simulation = scene()
            mujoco.mj_kinematics(simulation.model, simulation.data)
            perception = self._perception(simulation, view.cameras)
            if at_reset:
                perception.reset(rng)
                view.believed = self._settings.calibration.misplace(perception.believed, rng)
            perception.believed = view.believed
            view.seen, view.info = self._look(perception, simulation, rng)

    def _due(self, qpos: Array, age: float) -> bool:
        """Return True when images are due after a step that ends at positions (n + 7,), as the setting `observe` says.

        `step`: always. `reset`: never. `clear`: while the arm stands at home, where no camera's view is in its way.
        `10hz`: when the last are of 0.1 s ago.
        """
        observe = self._settings.observe
        if observe == "clear":
            arm = np.array(self._settings.cell.robot.arm.home)
            return bool(np.abs(qpos[: len(arm)] - arm).max() < 0.02)  # rad
        return observe == "step" or (observe == "10hz" and age > 0.1 - 1e-9)  # s

    def _choose(self, rng: Generator) -> tuple[str, ...]:
        """Names of the cameras that look; drawn only where fewer than all are asked for by number."""
        views = self._settings.views
        if not isinstance(views, int):
            return views
        names = self._settings.cell.camera_names
        if views == len(names):
            return names
        return tuple(names[k] for k in sorted(rng.permutation(len(names))[:views]))

    def _look(self, perception: Perception, simulation: Simulation, rng: Generator) -> tuple[Arrays, Fields]:
        """Return what cameras see, and with it poses as calibrated and pinhole parameters in pixels."""
        lenses = [camera.intrinsics for camera in perception.believed]
        info: Fields = {
            "perception_cameras": tuple(camera.name for camera in perception.cameras),
            "perception_T_world_camera": np.stack([camera.T_world_camera for camera in perception.believed]),
            "perception_intrinsics": np.array([[lens.fx, lens.fy, lens.cx, lens.cy] for lens in lenses]),
            "perception_failure": "",
        }
        if self._settings.obs_mode.endswith("pointcloud"):
            target_selection = self._settings.target_selection
            scene = perception.observe(simulation.data, rng, target_selection)
            info["perception_failure"] = scene.reason or ""
            if target_selection:
                info["perception_doubtful"] = bool(scene.target.doubt)
            return scene.as_observation(COUNT, AROUND_POINTS if target_selection else 0), info
        depth = perception.measure(simulation.data, rng)
        views: Arrays = {"depth": np.where(np.isfinite(depth), depth, 0.0).astype(np.float32)}
        if self._settings.obs_mode.endswith("rgbd"):
            names = self._settings.cell.camera_names
            colour: ColourCameras = self._context(
                "rgb", simulation, lambda: ColourCameras(simulation.model, self._cameras)
            )
            mujoco.mj_camlight(simulation.model, simulation.data)
            which = [names.index(camera.name) for camera in perception.cameras]
            views["rgb"] = colour.render_rgb(simulation.data)[which]
        return views, info

    def _perception(self, simulation: Simulation, names: tuple[str, ...]) -> Perception:
        """Return the cameras of a simulation, made anew when the object's size or their names have changed."""
        known, key = self._perceptions.get(simulation), (simulation.variation.size, names)
        if known is None or known[0] != key:
            by_name = {camera.name: camera for camera in self._cameras}
            perception = Perception(
                simulation.model,
                tuple(by_name[name] for name in names),
                sensor=self._settings.sensor,
                robot=None if known is None else known[1].robot,
            )
            known = self._perceptions[simulation] = key, perception
        return known[1]

    def _context(self, kind: str, simulation: Simulation, make: Callable[[], Any]) -> Any:
        """Return what draws; meshes are uploaded when it is made, in the size of the episode.

        There are as many of a kind as episodes at most: the one that was used last stays longest.
        """
        key = kind, simulation, simulation.variation.size
        found = self._contexts.pop(key, None)
        same = [other for other in self._contexts if other[0] == kind]
        if found is None and len(same) >= self._most:
            self._contexts.pop(same[0]).close()
        self._contexts[key] = found or make()
        return self._contexts[key]

    def render(self, mode: str | None, simulation: Simulation) -> Any:
        """Render the scene in a mode of `LiftEnv.metadata`."""
        if mode is None:
            raise InputError("render() needs a render_mode: pass render_mode='rgb_array' to gym.make")
        model, data = simulation.model, simulation.data
        if mode == "human":
            return self._context(mode, simulation, lambda: _open_viewer(model, data)).sync()
        size = self._settings.render_size
        renderer = self._context("picture", simulation, lambda: make_renderer(model, *size))
        if mode == "depth_array":
            renderer.enable_depth_rendering()
        camera = show_camera(self._settings.render_camera, data, simulation.cell.robot)
        picture = render(renderer, data, camera)
        renderer.disable_depth_rendering()
        return picture

    def close(self) -> None:
        """Free what draws and close the window."""
        while self._contexts:
            self._contexts.popitem()[1].close()


def _open_viewer(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError("render_mode 'human' needs a screen: none is here, use 'rgb_array'")
    import mujoco.viewer

    return mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
