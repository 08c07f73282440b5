"""The cameras that watch the table, and cameras as part of a model."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from dexgrasp_env.poses import matrix_to_quat
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics
from dexgrasp_env.robot.cell import active_cell

if TYPE_CHECKING:
    import mujoco

CAMERA_NAMES = tuple(camera.name for camera in active_cell().cameras)
"""Of the cell's cameras."""
_GL_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0])  # MuJoCo's cameras look along -z with y up


def default_cameras(intrinsics: CameraIntrinsics | None = None) -> tuple[Camera, ...]:
    """Return the cell's cameras, in the world frame.

    In the simulated one two stand at the table's front corners, two at the sides behind the objects. All of these see
    the whole region in which objects are put; the two at the back look past the arm.
    """
    return active_cell().make_cameras(intrinsics)


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
