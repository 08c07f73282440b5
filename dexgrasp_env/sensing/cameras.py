"""Cameras as part of a model."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from dexgrasp_env.poses import matrix_to_quat
from dexgrasp_env.robot.camera import Camera

if TYPE_CHECKING:
    import mujoco

_GL_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0])  # MuJoCo's cameras look along -z with y up


def add_cameras(spec: "mujoco.MjSpec", cameras: Iterable[Camera]) -> None:
    """Add the cameras to a model under construction, fixed to the world.

    MJCF knows a centred principal point only; the depth backends use the full intrinsics whatever is written
    here.
    """
    for camera in cameras:
        spec.worldbody.add_camera(
            name=camera.name,
            pos=camera.position,
            quat=matrix_to_quat(camera.rotation @ _GL_FROM_OPTICAL),
            fovy=camera.intrinsics.fovy,
            resolution=[camera.intrinsics.width, camera.intrinsics.height],
        )
