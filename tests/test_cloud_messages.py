"""What people are told and shown of their clouds: what stands in the way, a picture of all that was seen."""

import matplotlib.image
import numpy as np
import pytest
from robots import CELL
from test_neighbours import shell
from test_scene_cloud import scene_points

from dexgrasp.cli.codes import ANSWER_IS_NO, BAD_INPUT, OK
from dexgrasp.cli.main import main
from dexgrasp.cli.scan import blocking_lines
from dexgrasp.planning.plan_scene import plan_scene
from dexgrasp.planning.planner import Planner
from dexgrasp_env.perception.detected import detected_objects
from dexgrasp_env.perception.scene import ObjectCloud, Scene

HOME = CELL.robot.home


@pytest.fixture
def clouds(tmp_path):
    places = ((0.5, 0.12), (0.5, -0.12))
    for count in (1, 2):
        points = scene_points(np.random.default_rng(3), *places[:count])
        np.save(tmp_path / f"{count}.npy", points)
    np.save(tmp_path / "high.npy", points + np.array([0.0, 0.0, 0.3]))
    return tmp_path


def plan(clouds, name, *options):
    return main(["plan", "--cloud", str(clouds / f"{name}.npy"), "--out", str(clouds / "out"), *options])


def colours(path):
    """Number of colours that a picture has beside white and greys."""
    picture = np.round(matplotlib.image.imread(path)[..., :3] * 15).astype(int)
    return len(np.unique(picture[np.ptp(picture, axis=-1) > 4], axis=0))


def test_what_is_seen_is_drawn_with_the_grasp_and_where_there_is_none(clouds, capsys):
    assert plan(clouds, "1") == OK
    assert "seen.png" in capsys.readouterr().err
    with_one = colours(clouds / "out" / "seen.png")
    assert with_one > 3
    assert plan(clouds, "2") == BAD_INPUT
    said = capsys.readouterr().err.splitlines()
    assert said[0].endswith("seen.png")
    assert "several objects" in said[-1]
    assert colours(clouds / "out" / "seen.png") > with_one  # another object, another colour
    assert plan(clouds, "high") == ANSWER_IS_NO
    assert (clouds / "out" / "seen.png").stat().st_size > 10_000  # the points, of which no table was made


def leaning(x):
    """A thing beside the target at x = 0.5 whose top is over it."""
    upright = shell(x, 0.0, np.array([0.05, 0.06, 0.22]))
    points = upright.points - np.outer(upright.points[:, 2], [0.5, 0.0, 0.0])
    return ObjectCloud(points, np.zeros_like(points))


def test_what_blocks_a_lift_is_named():
    target, far = (
        shell(0.5, 0.0, np.array([0.05, 0.05, 0.08])),
        shell(0.5, 0.25, np.array([0.05, 0.05, 0.08])),
    )
    scene = Scene(target, neighbours=(far, leaning(0.6)))
    found = plan_scene(Planner(cell=CELL), scene, 0, HOME)
    assert found.reason == "no_grasp:lift_blocked"
    (line,) = blocking_lines(scene, detected_objects(scene, CELL.T_base_world), found)
    assert line.startswith("in the way of lifting it straight up: object 3 (")
    assert "at (0.54, 0.00, 0.11)" in line
    found.shortfall = "pregrasp_clearance"
    scene = Scene(target, neighbours=(far, shell(0.5, 0.08, np.array([0.05, 0.05, 0.08]))))
    (line,) = blocking_lines(scene, detected_objects(scene, CELL.T_base_world), found)
    assert line.startswith("perhaps too near for the hand: object 3 (")
    assert line.endswith("3.0 cm away")
