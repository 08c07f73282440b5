"""Noise model of a stereo or structured-light depth camera, and errors of its calibration.

Noise and quantisation live in disparity d = f B / z, where a stereo matcher works: a constant RMS of
`subpixel_rms` there is the depth RMS z^2 subpixel / (f B) that Intel publishes for its D400 cameras ("Tuning
depth cameras for best performance", Grunnet-Jepsen, Sweetser, Woodfill), with f in pixels of the camera's
own resolution.
"""

from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Annotated, Any

import numpy as np
from numpy.random import Generator

from dexgrasp_env.arrays import AnyArray, Mask, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import quat_to_matrix, rigid
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.valid import Count, Natural, Positive, check_fields, number, one_of, read

SENSORS = ("realistic", "captured", "none")
"""Names of models, which are those of their makers."""


@dataclass(frozen=True)
class Calibration:
    """Size of the error, of which the directions are drawn at each reset; none at zero.

    Attributes:
        position: m, in a random direction.
        rotation: rad, about a random axis through (0.5, 0, 0).
    """

    position: Annotated[float, number(ge=0, le=0.5)] = 0.0
    rotation: Annotated[float, number(ge=0, le=0.5)] = 0.0

    def misplace(self, cameras: tuple[Camera, ...], rng: Generator) -> tuple[Camera, ...]:
        """Return the cameras where a calibration with this error believes them to be; draws only if there is one."""
        if self == Calibration():
            return cameras
        shift, axis = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
        half = 0.5 * self.rotation
        R = quat_to_matrix(np.array([np.cos(half), *(np.sin(half) * axis)]))
        pivot = np.array([0.5, 0.0, 0.0])
        T = rigid(R, pivot - R @ pivot + self.position * shift)
        return tuple(Camera(c.name, T @ c.T_world_camera, c.intrinsics) for c in cameras)


Size = Annotated[float, number(ge=0)]
Probability = Annotated[float, number(ge=0, le=1)]


@dataclass(frozen=True)
class SensorModel:
    """Settings of the sensor; every part is off at zero.

    Attributes:
        focal_px: focal length of the stereo pair at its own resolution, pixels.
        baseline: between the two imagers, metres.
        subpixel_rms: RMS disparity noise, pixels of the stereo pair.
        correlated: share of the noise variance that neighbouring pixels share, 0 to 1.
        window: side of the squares over which they share it, pixels, odd.
        smear: side of the squares over which disparity is averaged, but at edges, pixels; 0 for none.
        disparity_step: quantum of disparity, pixels of the stereo pair.
        grazing_start: incidence from the surface normal at which pixels begin to drop out, radians.
        grazing_end: incidence from which none is left, radians; zero turns grazing dropouts off.
        edge_jump: a depth step between neighbouring pixels that counts as an edge, metres.
        edge_dropout: probability that a pixel at an edge drops out.
        edge_flying: probability that a pixel at an edge lies between the two sides.
        dropout: probability that any other pixel drops out.
        hidden_dropout: probability that a pixel drops out which the other imager does not see.
        hole_share: share of the image that is lost in holes.
        hole_size: width of the holes, pixels.
        calibration_position: RMS length of the error of a camera's position, metres.
        calibration_rotation: RMS angle of the error of its orientation, radians.
    """

    focal_px: Positive = 424.0
    baseline: Positive = 0.050
    subpixel_rms: Size = 0.0
    correlated: Probability = 0.0
    window: Count = 3
    smear: Natural = 0
    disparity_step: Size = 0.0
    grazing_start: Size = 0.0
    grazing_end: Size = 0.0
    edge_jump: Size = 0.02
    edge_dropout: Probability = 0.0
    edge_flying: Probability = 0.0
    dropout: Probability = 0.0
    hidden_dropout: Probability = 0.0
    hole_share: Probability = 0.0
    hole_size: Size = 3.0
    calibration_position: Size = 0.0
    calibration_rotation: Size = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        if self.window % 2 != 1:
            raise InputError(f"sensor window is {self.window}: valid are odd numbers from 1 on")

    @classmethod
    def none(cls) -> "SensorModel":
        """A perfect camera, perfectly calibrated."""
        return cls()

    @classmethod
    def realistic(cls) -> "SensorModel":
        """An Intel RealSense D435 at 848 x 480 on a good target, hand-eye calibrated.

        90 degrees over 848 pixels, 50 mm baseline, subpixel RMS 0.08 and disparity in 1/32 pixel (Intel):
        1.4 mm RMS at 0.6 m and 3.8 mm at 1 m. Dropouts, correlation and calibration are our judgement of a
        common cell.
        """
        return cls(
            subpixel_rms=0.08,
            correlated=0.5,
            disparity_step=1.0 / 32.0,
            grazing_start=np.radians(70.0),
            grazing_end=np.radians(85.0),
            edge_dropout=0.3,
            edge_flying=0.1,
            dropout=0.002,
            calibration_position=0.001,
            calibration_rotation=np.radians(0.15),
        )

    @classmethod
    def captured(cls) -> "SensorModel":
        """A structured-light camera (PrimeSense, Kinect) as its captures are: holes, flying pixels, steps of depth.

        580 pixels, 75 mm, disparity in 1/8 pixel and half a step of noise: 1.4 mm RMS and steps of 2.9 mm at 1 m
        (Khoshelham and Oude Elberink, Accuracy and resolution of Kinect depth data, 2012). What the projector, beside
        the camera, does not light is lost. Edges, holes and the width of the noise are our judgement of captures.
        """
        return cls(
            focal_px=580.0,
            baseline=0.075,
            subpixel_rms=0.0625,
            correlated=0.6,
            window=7,
            smear=7,
            disparity_step=1.0 / 8.0,
            grazing_start=np.radians(65.0),
            grazing_end=np.radians(82.0),
            edge_dropout=0.4,
            edge_flying=0.3,
            dropout=0.005,
            hidden_dropout=1.0,
            hole_share=0.02,
            calibration_position=0.002,
            calibration_rotation=np.radians(0.3),
        )

    @classmethod
    def of(cls, value: Any) -> "SensorModel":
        """Return the model of a name, one of `SENSORS`, or of a mapping of its settings.

        Raises:
            InputError: for an unknown name or setting, or a value out of range.
        """
        if isinstance(value, str):
            model: SensorModel = getattr(cls, one_of(SENSORS).validate(value))()
            return model
        return read(cls, value, "sensor")

    def measure(self, depths: Single, cameras: tuple[Camera, ...], rng: Generator) -> Single:
        """Return what the sensor reports for true depths.

        Args:
            depths: (cameras, H, W) metres, inf where nothing.
            cameras: their intrinsics give the angle of incidence.
            rng: the source of all randomness; the same number of values is drawn whatever the images show.

        Returns:
            (cameras, H, W) metres, inf where nothing or dropped out.
        """
        true = np.asarray(depths, np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            measured = self._with_flying(self._smeared(true) if self.smear else true, rng)
            if self.subpixel_rms or self.disparity_step:
                measured = self._through_disparity(measured, rng)
            if self.grazing_end or self.edge_dropout or self.dropout or self.hidden_dropout:
                lost = rng.random(true.shape, np.float32) < self._loss(true, cameras)
                measured = np.where(lost, np.float32(np.inf), measured)
            if self.hole_share:
                measured = np.where(self._holes(true.shape, rng), np.float32(np.inf), measured)
        return measured

    def calibrate(self, cameras: tuple[Camera, ...], rng: Generator) -> tuple[Camera, ...]:
        """Return the cameras where a calibration believes them to be; draw once an episode."""
        return tuple(camera.moved(self._calibration_error(rng)) for camera in cameras)

    def _calibration_error(self, rng: Generator) -> AnyArray:
        from scipy.spatial.transform import Rotation

        per_axis = 1.0 / np.sqrt(3.0)
        turn = Rotation.from_rotvec(self.calibration_rotation * per_axis * rng.standard_normal(3))
        return rigid(turn.as_matrix(), self.calibration_position * per_axis * rng.standard_normal(3))

    def _smeared(self, true: Single) -> Single:
        """Return depth as matching windows see it: rounded where things meet, cut off where one ends before another."""
        from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

        square = (1, self.smear, self.smear)
        edge = ~(maximum_filter(true, square) - minimum_filter(true, square) < self.edge_jump)
        return np.where(edge, true, 1.0 / uniform_filter(1.0 / true, square)).astype(np.float32)

    def _with_flying(self, true: Single, rng: Generator) -> Single:
        if not self.edge_flying:
            return true
        near, far = _extremes(true)
        share = rng.random(true.shape, np.float32)
        flying = (rng.random(true.shape, np.float32) < self.edge_flying) & (far - near > self.edge_jump)
        return np.where(flying & np.isfinite(far), near + share * (far - near), true)

    def _through_disparity(self, depth: Single, rng: Generator) -> Single:
        scale = np.float32(self.focal_px * self.baseline)
        disparity = scale / depth + np.float32(self.subpixel_rms) * self._noise(depth.shape, rng)
        if self.disparity_step:
            step = np.float32(self.disparity_step)
            disparity = np.rint(disparity / step) * step
        return np.where(np.isfinite(depth) & (disparity > 0), scale / disparity, np.float32(np.inf))

    def _noise(self, shape: tuple[int, ...], rng: Generator) -> Single:
        noise = rng.standard_normal(shape, np.float32)
        if not self.correlated:
            return noise
        n, h, w = shape
        side = self.window
        wide = rng.standard_normal((n, h + side - 1, w + side - 1), np.float32)
        rows = reduce(add, (wide[:, k : h + k] for k in range(side)))
        # A mean over the window, scaled back to unit variance.
        shared = reduce(add, (rows[:, :, k : w + k] for k in range(side))) / np.float32(side)
        return (
            np.float32(np.sqrt(1 - self.correlated)) * noise + np.float32(np.sqrt(self.correlated)) * shared
        )

    def _holes(self, shape: tuple[int, ...], rng: Generator) -> Mask:
        """Return which pixels are in holes: where a smooth random field is highest."""
        from scipy.ndimage import gaussian_filter

        field = gaussian_filter(rng.standard_normal(shape, np.float32), (0.0, self.hole_size, self.hole_size))
        return np.asarray(field > np.quantile(field, 1.0 - self.hole_share))

    def _loss(self, true: Single, cameras: tuple[Camera, ...]) -> Single:
        loss = np.full(true.shape, self.dropout, np.float32)
        if self.edge_dropout:
            near, far = _extremes(true)
            loss = np.where(far - near > self.edge_jump, np.float32(self.edge_dropout), loss)
        if self.grazing_end:
            angle = np.stack([incidence(d, c) for d, c in zip(true, cameras, strict=True)])
            ramp = (angle - self.grazing_start) / max(self.grazing_end - self.grazing_start, 1e-9)
            loss = np.maximum(loss, ramp)
        if self.hidden_dropout:
            hidden = np.stack([self._is_hidden(d, c) for d, c in zip(true, cameras, strict=True)])
            loss = np.where(hidden, np.maximum(loss, np.float32(self.hidden_dropout)), loss)
        return loss

    def _is_hidden(self, depth: Single, camera: Camera) -> Mask:
        """Return which pixels (H, W) the other imager does not see: what is nearer lies over them there."""
        columns = np.arange(depth.shape[1]) - camera.intrinsics.fx * self.baseline / depth
        right_of = np.minimum.accumulate(columns[:, ::-1], axis=1)[:, ::-1]
        return np.asarray(columns > right_of + 0.5)


def incidence(depth: Single, camera: Camera) -> Single:
    """Return the angle between the ray and the surface normal at each pixel, (H, W) radians.

    1/z is affine in the pixel on a plane, so its differences are the normal; the flatter side of a pixel
    counts, which leaves edges to the edge model.
    """
    i = camera.intrinsics
    inverse = np.where(np.isfinite(depth), 1.0 / depth, 0.0).astype(np.float32)
    a = np.float32(i.fx) * _flatter(np.diff(inverse, axis=1), 1)
    b = np.float32(i.fy) * _flatter(np.diff(inverse, axis=0), 0)
    rays = i.directions().astype(np.float32)
    c = inverse - a * rays[..., 0] - b * rays[..., 1]
    length = np.sqrt((a * a + b * b + c * c) * (rays * rays).sum(-1))
    return np.arccos(np.clip(inverse / np.maximum(length, 1e-12), 0.0, 1.0))


def _flatter(step: Single, axis: int) -> Single:
    """Return at each pixel the smaller of the differences to its two neighbours along an axis."""
    first, last = step.take([0], axis), step.take([-1], axis)
    before, after = np.concatenate([first, step], axis), np.concatenate([step, last], axis)
    return np.where(np.abs(before) < np.abs(after), before, after)


def _extremes(depth: Single) -> tuple[Single, Single]:
    """Return the nearest and farthest depth among each pixel and its four neighbours."""
    padded = np.pad(depth, ((0, 0), (1, 1), (1, 1)), mode="edge")
    around = (padded[:, :-2, 1:-1], padded[:, 2:, 1:-1], padded[:, 1:-1, :-2], padded[:, 1:-1, 2:])
    return np.minimum.reduce([depth, *around]), np.maximum.reduce([depth, *around])
