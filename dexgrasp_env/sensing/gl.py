"""Depth and colour through OpenGL, where there is one."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.sensing.groups import VISUAL_GROUPS, group_mask

if TYPE_CHECKING:
    import mujoco


class GLBackend:
    """`mujoco.Renderer` with the poses and intrinsics of `Camera`, not of the model's own cameras."""

    def __init__(
        self, model: "mujoco.MjModel", cameras: tuple[Camera, ...], groups: tuple[int, ...] = VISUAL_GROUPS
    ) -> None:
        from dexgrasp_env.rendering import make_renderer

        self.cameras = tuple(cameras)
        self._model = model
        i = cameras[0].intrinsics
        self._renderer = make_renderer(model, i.height, i.width)
        self._option = _scene_option(groups)

    def render(self, data: "mujoco.MjData") -> NDArray[np.float32]:
        """Return depth, (cameras, H, W) metres, inf where nothing."""
        self._renderer.enable_depth_rendering()
        depth = np.stack(self._images(data))
        self._renderer.disable_depth_rendering()
        depth[depth >= 0.999 * self._clip()[1]] = np.inf
        return depth

    def segment(self, data: "mujoco.MjData") -> NDArray[np.int32]:
        """Return geom ids, (cameras, H, W), -1 where nothing."""
        import mujoco

        self._renderer.enable_segmentation_rendering()
        pairs = np.stack(self._images(data))
        self._renderer.disable_segmentation_rendering()
        return np.where(pairs[..., 1] == mujoco.mjtObj.mjOBJ_GEOM, pairs[..., 0], -1).astype(np.int32)

    def render_rgb(self, data: "mujoco.MjData") -> NDArray[np.uint8]:
        """Return colour images, (cameras, H, W, 3)."""
        return np.stack(self._images(data))

    def close(self) -> None:
        """Free the GL context."""
        self._renderer.close()

    def _clip(self) -> tuple[float, float]:
        extent, planes = self._model.stat.extent, self._model.vis.map
        return planes.znear * extent, planes.zfar * extent

    def _images(self, data: "mujoco.MjData") -> list[NDArray[Any]]:
        images = []
        self._renderer.update_scene(data, scene_option=self._option)
        for camera in self.cameras:
            _aim(self._renderer.scene, camera, *self._clip())
            images.append(self._renderer.render().copy())
        return images


def _scene_option(groups: tuple[int, ...]) -> "mujoco.MjvOption":
    """Return what a depth camera sees: geoms of the groups, none of MuJoCo's decorations."""
    import mujoco

    option = mujoco.MjvOption()
    option.geomgroup[:] = group_mask(groups)
    for kind in (option.sitegroup, option.jointgroup, option.tendongroup, option.actuatorgroup):
        kind[:] = 0
    return option


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
