"""What cameras add to observations, and pictures for people."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.perception.cameras import default_cameras


class Views:
    """Camera observations of the environment; builds nothing until a mode asks for it."""

    def __init__(
        self, obs_mode: str, observe: str, sensor: Mapping[str, Any] | str, render_size: tuple[int, int]
    ) -> None:
        self._obs_mode, self._observe = obs_mode, observe
        self._render_size = render_size
        self._renderer: mujoco.Renderer | None = None
        self._viewer: Any = None
        self._shown: mujoco.MjModel | None = None
        intrinsics = default_cameras()[0].intrinsics
        self.image_shape = (len(default_cameras()), intrinsics.height, intrinsics.width)

    def observe(
        self, model: mujoco.MjModel, data: mujoco.MjData, rng: Generator, at_reset: bool
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return the camera part of an observation and of the info."""
        if self._obs_mode == "state":
            return {}, {}
        raise NotImplementedError

    def render(self, mode: str | None, model: mujoco.MjModel, data: mujoco.MjData) -> Any:
        """Render the scene in a mode of `LiftEnv.metadata`."""
        if mode is None:
            raise InputError("render() needs a render_mode: pass render_mode='rgb_array' to gym.make")
        if mode == "human":
            return self._show(model, data)
        from dexgrasp_env.rendering import make_renderer, render, show_camera

        if self._renderer is None or self._shown is not model:
            self.close()
            self._renderer, self._shown = make_renderer(model, *self._render_size), model
        if mode == "depth_array":
            self._renderer.enable_depth_rendering()
        picture = render(self._renderer, data, show_camera())
        self._renderer.disable_depth_rendering()
        return picture

    def _show(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if self._viewer is None or self._shown is not model:
            self.close()
            self._viewer, self._shown = _open_viewer(model, data), model
        self._viewer.sync()

    def close(self) -> None:
        """Free the renderer and close the window."""
        if self._renderer is not None:
            self._renderer.close()
        if self._viewer is not None:
            self._viewer.close()
        self._renderer = self._viewer = self._shown = None


def _open_viewer(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    import os

    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError("render_mode 'human' needs a screen: none is here, use 'rgb_array'")
    import mujoco.viewer

    return mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
