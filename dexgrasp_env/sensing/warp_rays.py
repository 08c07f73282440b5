"""Depth by rays on warp's device."""

import copy
from typing import Any

import mujoco
import numpy as np

from dexgrasp_env.arrays import Single
from dexgrasp_env.extras import from_extra
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.sensing.raycast import SEEN, RayCameras

with from_extra():
    import mujoco_warp as mjw
    import warp as wp


class WarpCameras(RayCameras):
    """Depth as `RayCameras` has it, by mujoco_warp's renderer; which geom a pixel shows is found on the host."""

    def __init__(self, model: mujoco.MjModel, cameras: tuple[Camera, ...], device: Any) -> None:
        """Send the scene to a device; the model has the cameras, by their names."""
        super().__init__(model, cameras)
        seen = copy.copy(model)
        seen.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # unknown to warp
        height, width = self._shape
        with wp.ScopedDevice(device):
            self._scene = mjw.put_model(seen)
            self._data = mjw.make_data(seen)
            self._context = mjw.create_render_context(
                seen,
                cam_res=(width, height),
                cam_active=[camera.name for camera in cameras],
                render_rgb=False,
                render_depth=True,
                render_seg=False,
                use_textures=False,
                enabled_geom_groups=np.flatnonzero(SEEN).tolist(),
            )

    def render(self, data: mujoco.MjData) -> Single:
        """Return depth, (cameras, H, W) metres, inf where nothing."""
        model, there, context = self._scene, self._data, self._context
        there.qpos.assign(data.qpos[None].astype(np.float32))
        with wp.ScopedDevice(there.qpos.device):
            mjw.kinematics(model, there)
            mjw.camlight(model, there)
            mjw.refit_bvh(model, there, context)
            mjw.render(model, there, context)
        depth: Single = context.depth_data.numpy().reshape(-1, *self._shape)
        return np.where(depth > 0.0, depth, np.float32(np.inf))
