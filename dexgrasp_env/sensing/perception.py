"""Cameras, sensor and pipeline tied to one scene."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp_env.perception.robot import RobotShape
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.perception.segment import SegmentationSettings, segment
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
        settings: SegmentationSettings | None = None,
    ) -> None:
        """Prepare the cameras.

        Args:
            model: robot, table and object.
            cameras: where they truly are.
            sensor: `SensorModel.realistic()`.
            settings: of the pipeline.
        """
        self.cameras = tuple(cameras)
        self.sensor = SensorModel.realistic() if sensor is None else sensor
        self.settings = settings or SegmentationSettings()
        self.rays = RayCameras(model, self.cameras)
        self.robot = RobotShape(model)
        self.believed = self.cameras

    def reset(self, rng: Generator) -> None:
        """Calibrate the cameras anew; once an episode."""
        self.believed = self.sensor.calibrate(self.cameras, rng)

    def measure(self, data: "mujoco.MjData", rng: Generator) -> NDArray[np.float32]:
        """Return the measured depth images, (cameras, H, W) m. `data` needs current kinematics."""
        return self.sensor.measure(self.rays.render(data), self.cameras, rng)

    def observe(self, data: "mujoco.MjData", rng: Generator) -> Scene:
        """Measure and segment. `data` needs current kinematics."""
        return segment(self.measure(data, rng), self.believed, rng, self.settings, self.robot.at(data))
