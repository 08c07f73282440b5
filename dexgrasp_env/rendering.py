"""Pictures: off-screen rendering that finds a GL library by itself, or says which one to install."""

import ctypes
import importlib
import os

import mujoco
import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError

_REMEDY = (
    "no off-screen GL library works here: install libosmesa6, or libegl1 with libgl1 (Debian names); "
    "everything but pictures and videos runs without"
)


def _loads(*libraries: str) -> bool:
    try:
        for library in libraries:
            ctypes.CDLL(library)
    except OSError:
        return False
    return True


def choose_gl() -> str | None:
    """Return the backend that MUJOCO_GL names, else the first that this machine has, else None."""
    if os.environ.get("MUJOCO_GL"):
        return os.environ["MUJOCO_GL"]
    # libegl1 alone cannot make a context: it needs libGL as well.
    if _loads("libEGL.so.1", "libGL.so.1"):
        return "egl"
    return "osmesa" if _loads("libOSMesa.so.8") else None


def make_renderer(model: mujoco.MjModel, height: int, width: int) -> mujoco.Renderer:
    """Return an off-screen renderer.

    Raises:
        InputError: with the remedy, where there is no GL.
    """
    import trimesh  # noqa: F401  (must be imported before a GL context exists)

    backend = choose_gl()
    if backend is None:
        raise InputError(_REMEDY)
    if not os.environ.get("MUJOCO_GL"):
        os.environ["MUJOCO_GL"] = backend
        os.environ.setdefault("PYOPENGL_PLATFORM", backend)
        _reload_context_module()
    model.vis.global_.offwidth = max(model.vis.global_.offwidth, width)
    model.vis.global_.offheight = max(model.vis.global_.offheight, height)
    try:
        return mujoco.Renderer(model, height, width)
    except Exception as error:
        raise InputError(f"{_REMEDY} (MUJOCO_GL={backend}: {error})") from error


def _reload_context_module() -> None:
    """MuJoCo reads MUJOCO_GL when it is imported; we know the answer only now."""
    from mujoco.rendering.classic import gl_context

    importlib.reload(gl_context)


def show_camera(distance: float = 1.45, azimuth: float = 146.0, elevation: float = -20.0) -> mujoco.MjvCamera:
    """Return a camera that shows the table and the robot from the front."""
    camera = mujoco.MjvCamera()
    camera.lookat[:] = [0.36, 0.0, 0.30]
    camera.distance, camera.azimuth, camera.elevation = distance, azimuth, elevation
    return camera


def show_options() -> mujoco.MjvOption:
    """Return options that draw visual geoms and hide collision shapes."""
    option = mujoco.MjvOption()
    mujoco.mjv_defaultOption(option)
    option.geomgroup[:] = [1, 1, 1, 0, 0, 0]
    option.sitegroup[:] = 0
    return option


def render(
    renderer: mujoco.Renderer, data: mujoco.MjData, camera: mujoco.MjvCamera | str | int
) -> NDArray[np.uint8]:
    """Render one colour picture (H, W, 3)."""
    renderer.update_scene(data, camera, show_options())
    return renderer.render()
