"""Colour through OpenGL, where there is one."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.robot.camera import Camera

if TYPE_CHECKING:
    import mujoco


class ColourCameras:
    """`mujoco.Renderer` with the poses and intrinsics of `Camera`, not of the model's own cameras."""

    def __init__(self, model: "mujoco.MjModel", cameras: tuple[Camera, ...]) -> None:
        from dexgrasp_env.rendering import make_renderer, show_options

        self._cameras, self._model = cameras, model
        i = cameras[0].intrinsics
        self.renderer = make_renderer(model, i.height, i.width)
        self._option = show_options()

    def render_rgb(self, data: "mujoco.MjData") -> NDArray[Any]:
        """Return colour images, (cameras, H, W, 3); `data` needs current kinematics."""
        images, extent, planes = [], self._model.stat.extent, self._model.vis.map
        self.renderer.update_scene(data, scene_option=self._option)
        for camera in self._cameras:
            _aim(self.renderer.scene, camera, planes.znear * extent, planes.zfar * extent)
            images.append(self.renderer.render().copy())
        return np.stack(images)

    def close(self) -> None:
        """Free the GL context."""
        self.renderer.close()


def _aim(scene: "mujoco.MjvScene", camera: Camera, near: float, far: float) -> None:
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
