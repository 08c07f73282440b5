"""Recorded clouds: one object is one however it is torn, stacks part by level, and what is not sure is said."""

import mujoco
import numpy as np
import pytest
import tables
from robots import CELL
from seen_tables import block
from test_scene_cloud import box, table

from dexgrasp.geometry.completion import completed_corners, guesses_said
from dexgrasp_env.perception import refinement, standing
from dexgrasp_env.perception.cloud import Cloud, gather
from dexgrasp_env.perception.pipeline import find_object, stand_on
from dexgrasp_env.perception.refinement import refine_instances
from dexgrasp_env.perception.scan import cloud_of
from dexgrasp_env.perception.selection import TargetSelector
from dexgrasp_env.poses import about_z
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics
from dexgrasp_env.sensing.raycast import RayCameras
from dexgrasp_env.sensing.sensor import SensorModel

BOXES = tables.table("boxes_seen")
LENS = CameraIntrinsics(320, 240, 290.0, 290.0, 159.5, 119.5)
EYE = Camera.look_at("eye", (1.0, 0.1, 0.5), (0.5, 0.0, 0.05), LENS)


def things(
    points: np.ndarray | Cloud, seed: int = 0, *, pointed: bool = True
) -> tuple[list[np.ndarray], list[str]]:
    """Return the points of the objects in a cloud, the largest first, and their doubts."""
    cloud = points if isinstance(points, Cloud) else cloud_of(points)
    _, support, above, _ = stand_on(cloud, np.random.default_rng(seed), CELL)
    found = refine_instances(above, support.cloud, support.plane, pointed=pointed)
    numbers = found.objects(above)
    return [above.points[found.labels == k] for k in numbers], [found.doubts[k] for k in numbers]


def views(*boxes: tuple[tuple[float, ...], tuple[float, ...]], eye: Camera = EYE) -> Cloud:
    """Return what a perfect camera sees of boxes on a table: sides and middles (3,) m of each."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.6, 0.8, 0.02], pos=[0.55, 0.0, -0.02])
    for sides, middle in boxes:
        half = [0.5 * side for side in sides]
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=middle)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return gather(RayCameras(model, (eye,)).render(data), (eye,))


def cup(rng: np.random.Generator, radius: float = 0.055, height: float = 0.08) -> np.ndarray:
    """Return the near outer and the far inner side of a cup, without its thin rim, as a camera at +x sees them."""
    angle, up = rng.uniform(-np.pi, np.pi, 5000), rng.uniform(0.0, 1.0, 5000)
    far = np.abs(angle) > 0.55 * np.pi
    seen = far | (np.abs(angle) < 0.48 * np.pi)
    up = np.where(far, 0.35 + 0.65 * up, up)
    points = np.column_stack([0.5 + radius * np.cos(angle), radius * np.sin(angle), height * up])[seen]
    return points + rng.normal(0.0, 0.0012, points.shape)


@pytest.mark.parametrize("seed", range(6))
def test_a_cup_is_one_thinned_turned_and_reseeded(seed):
    rng = np.random.default_rng(seed)
    points = np.concatenate([table(rng, 12000), cup(rng)])
    if seed % 2:
        points = points[rng.random(len(points)) < 0.5]
    turn = about_z(rng.uniform(0.0, 2.0 * np.pi))[:3, :3]
    found, doubts = things((points - [0.5, 0.0, 0.0]) @ turn.T + [0.5, 0.0, 0.0], seed)
    assert len(found) == 1
    assert doubts == [""]
    assert np.ptp(found[0], axis=0)[:2] == pytest.approx([0.11, 0.11], abs=0.012)


def test_splinters_along_a_thing_are_of_it_and_a_thing_beside_it_is_not(rng):
    body = box(rng, (0.5, 0.0), np.array([0.06, 0.09, 0.15]), 5000)
    strip = rng.uniform([0.534, -0.01, 0.06], [0.538, 0.005, 0.11], (130, 3))
    hanging = rng.uniform([0.49, 0.06, 0.10], [0.51, 0.065, 0.13], (120, 3))
    found, _ = things(np.concatenate([table(rng), body, strip, hanging]))
    assert len(found) == 1
    assert (found[0].max(0)[:2] > [0.536, 0.063]).all()
    found, doubts = things(
        np.concatenate([table(rng), body, box(rng, (0.5, 0.09), np.array([0.05, 0.05, 0.06]))])
    )
    assert len(found) == 2  # 2 cm apart
    assert doubts == ["", ""]


def test_what_stands_on_another_is_another_and_its_hull_ends_there():
    scene = views(BOXES["lower"], BOXES["upper"])
    found, doubts = things(scene)
    assert len(found) == 2
    assert all(refinement.TOUCHES in doubt for doubt in doubts)
    meant = TargetSelector(near=np.array([0.52, 0.0, 0.13]))
    upper = find_object(scene, np.random.default_rng(0), CELL, selector=meant)
    assert upper.target.foot == pytest.approx(0.06, abs=0.004)
    corners, _ = completed_corners(upper.target, upper.plane)
    assert corners is not None
    assert corners[:, 2].min() == pytest.approx(0.06, abs=0.006)
    mask = np.zeros(np.prod(scene.shape), bool)
    mask[scene.pixel[scene.points[:, 2] > 0.065]] = True
    masked = find_object(scene, np.random.default_rng(0), CELL, selector=TargetSelector(mask=mask))
    assert masked.target.foot == pytest.approx(0.06, abs=0.004)


def test_what_is_seen_through_a_hole_lines_the_walls():
    steep = Camera.look_at("steep", (0.85, 0.1, 0.65), (0.5, 0.0, 0.05), LENS)
    found, _ = things(cloud_of(views(*tables.table("open_box"), eye=steep).points))
    assert len(found) == 1


def test_a_handle_is_of_what_it_hangs_on_and_a_small_thing_of_what_it_touches_where_none_is_pointed_at():
    body = BOXES["body"]
    found, doubts = things(cloud_of(views(body, BOXES["handle"]).points))
    assert len(found) == 1
    touching = cloud_of(views(body, BOXES["beside"]).points)
    assert len(things(touching)[0]) == 2
    found, doubts = things(touching, pointed=False)
    assert len(found) == 1
    assert refinement.MAY_BE_TWO in doubts[0]
    assert len(things(cloud_of(views(body, BOXES["on_it"]).points), pointed=False)[0]) == 2


def test_what_would_topple_is_of_what_carries_it_and_a_top_that_runs_on_is_no_seam():
    drill = cloud_of(views(BOXES["battery"], BOXES["barrel"]).points)
    assert things(drill, pointed=False)[1] == [""]
    assert len(things(drill)[0]) == 2
    assert things(cloud_of(views(BOXES["long"], BOXES["across"]).points))[1] == [""]
    lamp = views(BOXES["base"], BOXES["pole"], BOXES["shade"])
    assert things(cloud_of(lamp.points), pointed=False)[1] == [""]


def test_what_is_long_and_dented_may_be_two_unless_a_neck_a_rod_or_its_top_makes_it_one(rng):
    def may_be_two(*names):
        boxes = (BOXES[name] for name in names)
        return standing.may_be_two(
            np.concatenate([block(rng, m[:2], s, m[2] - 0.5 * s[2], 0.005) for s, m in boxes])
        )

    assert may_be_two("lower", "upper")
    assert may_be_two("body", "on_it")
    assert may_be_two("body", "beside")
    for one in (["body", "handle"], ["base", "pole", "shade"], ["long", "across"], ["battery", "barrel"]):
        assert not may_be_two(*one)
    assert not may_be_two("guessed")


def test_boards_and_bins_are_not_meant_where_something_smaller_stands():
    scene = find_object(
        cloud_of(views(BOXES["small"], BOXES["board"]).points), np.random.default_rng(0), CELL
    )
    assert scene.reason is None
    assert np.ptp(scene.target.points[:, 2]) > 0.06
    assert len(scene.neighbours) == 1


@pytest.mark.parametrize("known", [True, False])
def test_what_another_hides_in_part_is_doubtful(known):
    cloud = views(BOXES["before"], BOXES["behind"])
    found, doubts = things(cloud if known else cloud_of(cloud.points))
    hidden = [refinement.HIDDEN in doubt for doubt in doubts]
    behind = [bool(points[:, 0].mean() < 0.47) for points in found]
    assert len(found) >= 2
    assert hidden == behind


def test_a_side_that_is_guessed_is_said():
    front = Camera.look_at("front", (1.1, 0.25, 0.12), (0.5, 0.0, 0.07), LENS)
    scene = find_object(views(BOXES["guessed"], eye=front), np.random.default_rng(0), CELL)
    assert "side that no camera saw" in guesses_said(scene).target.doubt


def test_a_captured_image_has_holes_shadows_and_steps():
    camera = Camera.look_at("c", (0.5, 0.0, 0.8), (0.5001, 0.0, 0.0), LENS)
    step = np.full((1, 240, 320), 0.8, np.float32)
    step[:, :, 160:] = 0.5

    def measured(depth, **settings):
        return SensorModel(**settings).measure(depth, (camera,), np.random.default_rng(0))[0]

    lost = ~np.isfinite(measured(step, focal_px=580.0, baseline=0.075, hidden_dropout=1.0))
    wide = 290.0 * 0.075 * (1.0 / 0.5 - 1.0 / 0.8)  # pixels, of which the other imager sees the nearer side
    assert lost[100].sum() == pytest.approx(wide, abs=1.5)
    assert lost[100, 150]
    holes = measured(np.full((1, 240, 320), 0.8, np.float32), hole_share=0.05)
    assert (~np.isfinite(holes)).mean() == pytest.approx(0.05, abs=0.005)
    assert 0.791 < measured(np.where(step < 0.6, 0.79, step), smear=7, edge_jump=0.02)[100, 159] < 0.799


@pytest.fixture
def rng():
    return np.random.default_rng(3)
