"""Depth by ray casting: no GL, the same bits everywhere."""

import copy
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.camera import Camera

if TYPE_CHECKING:
    import mujoco

SEEN = np.array([1, 1, 1, 0, 0, 0], np.uint8)
"""Flags of MuJoCo's six geom groups: whether cameras see them; collision geoms are in group 3."""


class RayCameras:
    """One ray a pixel through `mj_multiRay` (`mujoco.batch` rays cost 1.5 times as much).

    Later changes to the sizes of the model's geoms are not seen.

    Raises:
        InputError: for no camera at all or image sizes that differ, because images are stacked.
    """

    def __init__(self, model: "mujoco.MjModel", cameras: tuple[Camera, ...]) -> None:
        if not cameras:
            raise InputError("no cameras given: valid are one or more")
        if len({(c.intrinsics.width, c.intrinsics.height) for c in cameras}) > 1:
            raise InputError("cameras have different image sizes: valid is one size for all")
        self.cameras = cameras
        self._model = ray_model(model)
        i = cameras[0].intrinsics
        self._shape = (i.height, i.width)
        # With rays scaled to z = 1 in the optical frame the ray parameter is the depth.
        self.rays = [(c.intrinsics.directions().reshape(-1, 3) @ c.rotation.T).ravel() for c in cameras]
        self._distance = np.empty((len(cameras), i.height * i.width))
        self._geom = np.empty_like(self._distance, np.int32)

    def render(self, data: "mujoco.MjData") -> Single:
        """Return depth, (cameras, H, W) metres, inf where nothing; `data` needs current kinematics."""
        self._cast(data)
        depth = self._distance.astype(np.float32)
        depth[depth < 0] = np.inf
        return depth.reshape(-1, *self._shape)

    def segment(self, data: "mujoco.MjData") -> NDArray[np.int32]:
        """Return the geom each pixel shows, (cameras, H, W), -1 where nothing."""
        self._cast(data)
        return self._geom.reshape(-1, *self._shape).copy()

    def _cast(self, data: "mujoco.MjData") -> None:
        import mujoco

        for k, camera in enumerate(self.cameras):
            mujoco.mj_multiRay(
                self._model, data, camera.position, self.rays[k], SEEN, True, -1,
                self._geom[k], self._distance[k], None, self._distance.shape[1],
                10.0,  # m: geoms farther away are not looked at
            )  # fmt: skip


def ray_model(model: "mujoco.MjModel") -> "mujoco.MjModel":
    """Return a copy of the model in which `mj_multiRay` misses nothing; fit for rays only.

    MuJoCo 3.17 culls a body by a box that is misplaced when the inertial frame is rotated or off the geoms'
    centre, and then returns what lies behind. A box about the body's origin that reaches as far as the old
    one in every direction holds the body however it is turned, so nothing visible is culled.
    """
    ray_only = copy.copy(model)
    roots = ray_only.body_bvhadr[ray_only.body_bvhadr >= 0]
    boxes = ray_only.bvh_aabb[roots]
    boxes[:, 3:] += np.linalg.norm(boxes[:, :3], axis=1, keepdims=True)
    boxes[:, :3] = 0.0
    ray_only.bvh_aabb[roots] = boxes
    return ray_only
