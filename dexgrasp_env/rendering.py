"""Pictures: off-screen rendering that finds a GL library by itself, or says which one to install."""

import atexit
import ctypes
import importlib.util
import os
import threading
import weakref
from contextlib import suppress
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import AnyArray
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.robot.robot import Robot
from dexgrasp_env.valid import number, several

_OFF = ("disable", "disabled", "off", "false", "0")  # MUJOCO_GL's words for no drawing
RENDER_SIZE = several(number(ge=16, le=4096, whole=True), 2)._replace(
    words="rows and columns, each from 16 to 4096"
)
"""The rule of rows and columns of pictures, pixels."""
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


def wished_gl() -> str:
    """Return the backend that MUJOCO_GL names, in lower case; an empty text where it names none.

    MUJOCO_GL is put aside as DEXGRASP_GL where its value would fail `import mujoco`.
    """
    wish = (os.environ.get("DEXGRASP_GL") or os.environ.get("MUJOCO_GL") or "").lower().strip()
    return "" if wish in ("enable", "enabled", "on", "true", "1") else wish  # words for whatever there is


def choose_gl() -> str | None:
    """Return the backend that MUJOCO_GL names, else the first that this machine has, else None."""
    if wish := wished_gl():
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
    """Return an off-screen renderer: without multisampling, with coarse shadows, a third of the time of a software GL.

    Args:
        model: what is drawn.
        height: of the pictures, pixels.
        width: of the pictures, pixels.

    Raises:
        InputError: with the remedy, where there is no GL.
    """
    import trimesh  # noqa: F401  (must be imported before a GL context exists)

    backend = choose_gl()
    if backend is None:
        raise InputError(_REMEDY)
    if backend in _OFF:
        raise InputError(f"MUJOCO_GL={backend} turns drawing off: unset it, or set it to egl or osmesa")
    if _drew_in and os.getpid() not in _drew_in:
        raise InputError(
            "pictures were drawn in the process that this one was forked from: start workers with context='spawn', "
            "in gym.make_vec by vector_kwargs={'context': 'spawn'}"
        )
    model.vis.global_.offwidth = max(model.vis.global_.offwidth, width)
    model.vis.global_.offheight = max(model.vis.global_.offheight, height)
    try:
        with _lock:
            _load_triton()
            _use(backend)
            renderer = _quick_renderer(model, height, width)
            _drew_in.add(os.getpid())
            _open.add(renderer)
            _close_at_exit()
        return renderer
    except Exception as error:
        raise InputError(f"{_REMEDY} (MUJOCO_GL={backend}: {error})") from error


_lock = threading.Lock()  # one thread at a time settles on a backend and makes a context
_drew_in: set[int] = set()  # processes with a GL context: it does not outlive a fork
_open: weakref.WeakSet[mujoco.Renderer] = weakref.WeakSet()


@cache
def _load_triton() -> None:
    """Load triton's library, which torch brings, before a GL: its LLVM crashes where Mesa's was there first."""
    found = importlib.util.find_spec("triton")
    for folder in found.submodule_search_locations or () if found else ():
        for library in Path(folder, "_C").glob("libtriton*.so"):
            with suppress(OSError):
                ctypes.CDLL(str(library))


@cache
def _close_at_exit() -> None:
    """Close open renderers at exit; registered after EGL's first use, so that it runs before EGL's own end."""
    atexit.register(lambda: [renderer.close() for renderer in tuple(_open)])


def _quick_renderer(model: mujoco.MjModel, height: int, width: int) -> mujoco.Renderer:
    quality = model.vis.quality
    before = quality.offsamples, quality.shadowsize
    quality.offsamples, quality.shadowsize = 0, 1024
    try:
        renderer = mujoco.Renderer(model, height, width)
    finally:
        quality.offsamples, quality.shadowsize = before
    renderer.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
    return renderer


def use_offscreen_gl() -> None:
    """Settle on a backend before another library does, where there is no screen; nothing without a backend."""
    backend = choose_gl()
    if (
        backend
        and backend not in _OFF
        and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    ):
        _load_triton()
        _use(backend)


def _use(backend: str) -> None:
    """Select a backend for MuJoCo, unless it is in use; where it fails, the process's variables stay as they were."""
    if os.environ.get("MUJOCO_GL"):
        return
    added = [name for name in ("MUJOCO_GL", "PYOPENGL_PLATFORM") if not os.environ.get(name)]
    os.environ.update(dict.fromkeys(added, backend))
    try:  # MuJoCo reads MUJOCO_GL when it is imported; we know the answer only now
        from mujoco.rendering.classic import gl_context

        importlib.reload(gl_context)
    except BaseException:
        for name in added:
            del os.environ[name]
        raise


SHOW_CAMERAS = ("front", "grasp")
"""What pictures for people can be taken with beside the depth cameras: the whole cell, the grasp from close by."""


def show_camera(
    name: str = "front", data: mujoco.MjData | None = None, robot: Robot | None = None
) -> mujoco.MjvCamera | str:
    """Return one of `SHOW_CAMERAS`, or the name of another.

    Args:
        name: `front` shows the table and the robot; `grasp` is close to the hand and follows it; the others are the
            model's.
        data: with the positions of now, for `grasp`.
        robot: whose hand it is, for `grasp`.
    """
    if name not in SHOW_CAMERAS:
        return name
    camera = mujoco.MjvCamera()
    camera.lookat[:] = 0.36, 0.0, 0.30
    camera.distance, camera.azimuth, camera.elevation = 1.45, 146.0, -20.0
    if name == "grasp":
        assert data is not None and robot is not None
        camera.lookat[:] = np.mean([data.site(site).xpos for site in (robot.hand.palm, *robot.tips)], axis=0)
        camera.distance, camera.elevation = 0.55, -15.0
    return camera


def show_options() -> mujoco.MjvOption:
    """Return options that draw visual geoms and hide collision shapes."""
    option = mujoco.MjvOption()
    option.geomgroup[:] = [1, 1, 1, 0, 0, 0]
    option.sitegroup[:] = 0
    return option


def render(
    renderer: mujoco.Renderer, data: mujoco.MjData, camera: mujoco.MjvCamera | str | int
) -> NDArray[np.uint8]:
    """Render one colour picture (H, W, 3): the same for the same state, whatever was drawn before."""
    for _ in range(2):  # the light at the camera is where the camera was at the update before
        renderer.update_scene(data, camera, show_options())
    return renderer.render()


class ColourCameras:
    """`mujoco.Renderer` with the poses and intrinsics of `Camera`, not of the model's own cameras.

    Pictures are for policies, by the thousand: without shadows and multisampling they take a ninth of the time.
    """

    def __init__(self, model: mujoco.MjModel, cameras: tuple[Camera, ...]) -> None:
        self._cameras, i = cameras, cameras[0].intrinsics
        self.renderer = make_renderer(model, i.height, i.width)
        self.renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        self._option = show_options()

    def render_rgb(self, data: mujoco.MjData) -> AnyArray:
        """Return colour images, (cameras, H, W, 3); `data` needs current kinematics."""
        images, model = [], self.renderer.model
        extent, planes = model.stat.extent, model.vis.map
        for _ in range(2):  # as in `render`
            self.renderer.update_scene(data, scene_option=self._option)
        for camera in self._cameras:
            _aim(self.renderer.scene, camera, planes.znear * extent, planes.zfar * extent)
            images.append(self.renderer.render().copy())
        return np.stack(images)

    def close(self) -> None:
        """Free the GL context."""
        self.renderer.close()


def _aim(scene: mujoco.MjvScene, camera: Camera, near: float, far: float) -> None:
    """Set pose and frustum of the scene's camera from the full intrinsics."""
    i = camera.intrinsics
    for gl in scene.camera:
        gl.pos[:] = camera.position
        gl.forward[:] = camera.rotation[:, 2]
        gl.up[:] = -camera.rotation[:, 1]
        gl.orthographic = 0
        gl.frustum_near, gl.frustum_far = near, far
        # Pixel centres are at integers, so the image spans -0.5 to size - 0.5.
        gl.frustum_top = near * (i.cy + 0.5) / i.fy
        gl.frustum_bottom = near * (i.cy + 0.5 - i.height) / i.fy
        gl.frustum_center = near * (0.5 * i.width - 0.5 - i.cx) / i.fx
        gl.frustum_width = near * 0.5 * i.width / i.fx
