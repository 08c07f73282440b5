"""Cameras, rays and the sensor model."""

import mujoco
import numpy as np
import pytest
from robots import CELL, room, simulated

from dexgrasp_env.errors import InputError
from dexgrasp_env.rendering import ColourCameras
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics
from dexgrasp_env.sensing.raycast import RayCameras
from dexgrasp_env.sensing.sensor import SensorModel

GEOM = mujoco.mjtGeom


def small_scene(floor: bool = True) -> tuple[mujoco.MjModel, mujoco.MjData]:
    spec = room(floor)
    body = spec.worldbody.add_body(name="object", pos=[0.5, 0.05, 0.06], quat=[0.9, 0.1, 0.2, 0.3])
    body.add_freejoint()
    body.add_geom(type=GEOM.mjGEOM_BOX, size=[0.03, 0.04, 0.05])
    # An inertial frame off the geoms' centre and turned: what mj_multiRay culls wrongly.
    body.mass, body.inertia, body.explicitinertial = 1.0, [0.01, 0.011, 0.012], True
    body.ipos, body.iquat = [0.1, -0.1, 0.05], [0.5, 0.5, -0.5, 0.5]
    return simulated(spec)


def test_rays_miss_nothing_that_single_rays_hit():
    model, data = small_scene()
    cameras = CELL.make_cameras(CameraIntrinsics.from_fovy(38.0, 80, 60))
    depths = RayCameras(model, cameras).render(data)
    group, geom = np.array([1, 1, 1, 0, 0, 0], np.uint8), np.zeros(1, np.int32)
    for depth, camera in zip(depths, cameras, strict=True):
        rays = camera.intrinsics.directions().reshape(-1, 3) @ camera.rotation.T
        single = [mujoco.mj_ray(model, data, camera.position, ray, group, 1, -1, geom) for ray in rays]
        assert np.allclose(depth.ravel(), single, atol=1e-6)


def test_gl_and_rays_agree_pixel_by_pixel():
    model, data = small_scene(floor=False)
    shifted = CameraIntrinsics(fx=180.0, fy=165.0, cx=70.0, cy=66.0)
    cameras = tuple(Camera(c.name, c.T_world_camera, shifted) for c in CELL.make_cameras())
    try:
        gl = ColourCameras(model, cameras)
    except InputError as error:
        pytest.skip(str(error))
    rays = RayCameras(model, cameras)
    try:
        assert gl.render_rgb(data).shape == (4, 120, 160, 3)
        gl.renderer.enable_depth_rendering()
        a, b = rays.render(data), gl.render_rgb(data)
        b[b >= 0.999 * model.vis.map.zfar * model.stat.extent] = np.inf
        gl.renderer.disable_depth_rendering()
        gl.renderer.enable_segmentation_rendering()
        pairs = gl.render_rgb(data)
    finally:
        gl.close()
    shown = np.where(pairs[..., 1] == mujoco.mjtObj.mjOBJ_GEOM, pairs[..., 0], -1)
    assert (rays.segment(data) != shown).mean() < 2e-3
    assert (np.isfinite(a) != np.isfinite(b)).mean() < 2e-3
    both = np.isfinite(a) & np.isfinite(b)
    error = np.abs(a[both] - b[both])
    assert np.median(error) < 1e-5
    assert (error > 2e-3).mean() < 2e-3


@pytest.mark.parametrize("distance", [0.5, 1.0])
@pytest.mark.parametrize("correlated", [0.0, 0.5])
def test_noise_grows_with_the_square_of_distance(distance, correlated):
    sensor = SensorModel(subpixel_rms=0.08, correlated=correlated)
    depth = np.full((4, 120, 160), distance, np.float32)
    measured = sensor.measure(depth, CELL.make_cameras(), np.random.default_rng(1))
    expected = distance**2 * 0.08 / (424 * 0.05)
    assert distance**2 * sensor.subpixel_rms / (sensor.focal_px * sensor.baseline) == pytest.approx(expected)
    assert (measured - depth).std() == pytest.approx(expected, rel=0.05)


def test_quantisation_is_in_disparity():
    depth = np.linspace(0.4, 1.0, 4 * 120 * 160, dtype=np.float32).reshape(4, 120, 160)
    measured = SensorModel(disparity_step=0.25).measure(depth, CELL.make_cameras(), np.random.default_rng(0))
    disparity = 424 * 0.05 / measured / 0.25
    assert np.allclose(disparity, np.rint(disparity), atol=1e-3)


def test_grazing_surfaces_and_edges_drop_out():
    camera = Camera.look_at("c", (0, 0, 0.1), (1.0, 0, 0))  # the table under a flat angle
    rays = camera.intrinsics.directions() @ camera.rotation.T
    depth = np.where(rays[..., 2] < -1e-3, -0.1 / np.minimum(rays[..., 2], -1e-3), np.inf).astype(np.float32)
    true = np.arccos(-rays[..., 2] / np.linalg.norm(rays, axis=-1))
    sensor = SensorModel(grazing_start=np.radians(70), grazing_end=np.radians(80))
    out = sensor.measure(depth[None], (camera,), np.random.default_rng(0))[0]
    assert np.isinf(out[true > np.radians(82)]).all()
    assert np.isfinite(out[60:][true[60:] < np.radians(68)]).all()
    step = np.full((1, 120, 160), 0.5, np.float32)
    step[:, :, 80:] = 0.8
    lost = np.isinf(SensorModel(edge_dropout=0.5).measure(step, (camera,), np.random.default_rng(0))[0]).mean(
        0
    )
    assert lost[[79, 80]] == pytest.approx([0.5, 0.5], abs=0.15)
    assert lost[:79].max() == 0
