"""Pictures: off-screen rendering that finds a GL library by itself, or says which one to install."""

import ctypes
import importlib
import os

import mujoco
import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError

_OFF = ("disable", "disabled", "off", "false", "0")  # MUJOCO_GL's words for no drawing,
_ANY = ("enable", "enabled", "on", "true", "1")  # and for whatever there is
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
    """Return the backend that MUJOCO_GL names, else the first that this machine has, else None.

    The command line puts MUJOCO_GL aside as DEXGRASP_GL, as a bad value would fail `import mujoco`.
    """
    wish = (os.environ.get("DEXGRASP_GL") or os.environ.get("MUJOCO_GL") or "").lower().strip()
    if wish and wish not in _ANY:
        return wish
    # libegl1 alone cannot make a context: it needs libGL as well.
    if _loads("libEGL.so.1", "libGL.so.1"):
        return "egl"
    return "osmesa" if _loads("libOSMesa.so.8") else None


def rendering_fault() -> str | None:
    """Return why nothing can be drawn here, with the remedy in one line; None where drawing works."""
    try:
        with make_renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16) as renderer:
            renderer.update_scene(mujoco.MjData(renderer.model))
            renderer.render()
    except Exception as error:
        return " ".join(str(error).split())
    return None


def make_renderer(model: mujoco.MjModel, height: int, width: int) -> mujoco.Renderer:
    """Return an off-screen renderer.

    Raises:
        InputError: with the remedy, where there is no GL.
    """
    import trimesh  # noqa: F401  (must be imported before a GL context exists)

    backend = choose_gl()
    if backend is None:
        raise InputError(_REMEDY)
    if backend in _OFF:
        raise InputError(f"MUJOCO_GL={backend} turns drawing off: unset it, or set it to egl or osmesa")
    model.vis.global_.offwidth = max(model.vis.global_.offwidth, width)
    model.vis.global_.offheight = max(model.vis.global_.offheight, height)
    try:
        _use(backend)
        return mujoco.Renderer(model, height, width)
    except Exception as error:
        raise InputError(f"{_REMEDY} (MUJOCO_GL={backend}: {error})") from error


def use_offscreen_gl() -> None:
    """Settle on a backend before another library does, where there is no screen; nothing without a backend."""
    backend = choose_gl()
    if (
        backend is not None
        and backend not in _OFF
        and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    ):
        _use(backend)


def _use(backend: str) -> None:
    """Have MuJoCo draw with a backend, unless it does; where it cannot, the environment stays as it was."""
    if os.environ.get("MUJOCO_GL"):
        return
    os.environ["MUJOCO_GL"] = backend
    os.environ.setdefault("PYOPENGL_PLATFORM", backend)
    try:
        _reload_context_module()
    except BaseException:
        del os.environ["MUJOCO_GL"], os.environ["PYOPENGL_PLATFORM"]
        raise


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
