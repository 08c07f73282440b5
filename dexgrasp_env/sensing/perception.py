"""Cameras, sensor and pipeline tied to one scene."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import Single
from dexgrasp_env.perception.cloud import WORKSPACE_HIGH, WORKSPACE_LOW, deproject, is_valid
from dexgrasp_env.perception.pipeline import segment
from dexgrasp_env.perception.robot import RobotShape
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.perception.selection import TargetSelector
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.sensing.raycast import RayCameras
from dexgrasp_env.sensing.sensor import SensorModel

if TYPE_CHECKING:
    import mujoco


class Perception:
    """Depth cameras that watch the table of one model."""

    def __init__(
        self,
        model: "mujoco.MjModel",
        cameras: tuple[Camera, ...],
        *,
        sensor: SensorModel | None = None,
        robot: RobotShape | None = None,
    ) -> None:
        """Prepare the cameras.

        Args:
            model: robot, table and object.
            cameras: where they truly are.
            sensor: `SensorModel.realistic()`.
            robot: of a model with the same robot, where it has been read before.
        """
        self.cameras = cameras
        self.sensor = SensorModel.realistic() if sensor is None else sensor
        self.rays = RayCameras(model, cameras)
        self.robot = RobotShape(model) if robot is None else robot
        self._of_object = model.geom_bodyid == model.body("object").id  # geoms
        self.believed = cameras

    def reset(self, rng: Generator) -> None:
        """Calibrate the cameras anew; once an episode."""
        self.believed = self.sensor.calibrate(self.cameras, rng)

    def measure(self, data: "mujoco.MjData", rng: Generator) -> Single:
        """Return the measured depth images, (cameras, H, W) m. `data` needs current kinematics."""
        return self.sensor.measure(self.rays.render(data), self.cameras, rng)

    def observe(self, data: "mujoco.MjData", rng: Generator, target_selection: str | None = None) -> Scene:
        """Measure and segment. `data` needs current kinematics.

        Args:
            data: where everything is.
            rng: of sensor and segmentation.
            target_selection: `true`: a mask says which pixels show the object; `perceived`: a point on it is named;
                `any`: the one nearest to the middle of the workspace is taken; None: the largest thing that is seen.
        """
        depths = self.measure(data, rng)
        pointed: TargetSelector | None = None
        if target_selection == "any":
            pointed = TargetSelector(near=np.mean([WORKSPACE_LOW, WORKSPACE_HIGH], axis=0))
        elif target_selection:
            pointed = self._point(data, depths, target_selection == "true")
        return segment(depths, self.believed, rng, self.robot.at(data), pointed)

    def _point(self, data: "mujoco.MjData", depths: Single, masked: bool) -> TargetSelector:
        """Point at the object by its mask, or by the middle pixel of where it is seen best."""
        shown = self.rays.segment(data)
        mask = (shown >= 0) & self._of_object[shown]
        known = mask & is_valid(depths)
        if masked or not known.any():
            return TargetSelector(mask=mask)
        k = int(known.sum(axis=(1, 2)).argmax())
        pixels = np.argwhere(known[k])
        row, column = pixels[((pixels - pixels.mean(axis=0)) ** 2).sum(axis=1).argmin()]
        return TargetSelector(near=deproject(depths[k], self.believed[k])[row, column])
