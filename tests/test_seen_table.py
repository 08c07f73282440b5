"""The table is where it is seen: levels told apart, plans that keep clear of it, files that say so."""

import copy
from functools import cache, partial

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from refusals import rejected
from robots import CELL
from seen_tables import AMID, GIVEN, block, find, flat, height_over, leaning, seen_at, standing, without
from tables import table

from dexgrasp.export.check import check_trajectory
from dexgrasp.export.grasp_export import export_grasp
from dexgrasp.export.read import read_trajectory
from dexgrasp.grasp.file import record_of
from dexgrasp.grasp.planned_record import Origin, grasp_json, planned_record
from dexgrasp.grasp.record import as_json
from dexgrasp.grasp.verify.verify import verify
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.planning.plan_scene import plan_cloud
from dexgrasp_env.perception.pipeline import find_object
from dexgrasp_env.perception.scan import read_scan
from dexgrasp_env.robot.model import compiled_robot, robot_spec
from dexgrasp_env.robot.table import SeenTable

BAR, CARTON = (0.035, 0.14, 0.026), (0.06, 0.09, 0.12)


def file_of(points, seed=0, **pointing):
    """The grasp file of a plan, or the reason why there is none."""
    plan = plan_cloud(points, seed=seed, **pointing)
    if plan.grasp is None:
        return plan.reason
    origin, script = Origin("bilevel"), plan.found[0].script
    return grasp_json(
        planned_record("it", plan.grasp, plan.target, plan.settings, script=script, origin=origin)
    )


@cache
def bar_on_a_higher_table():
    """A low bar on a table 14 mm higher that leans by 1.5 degrees, a carton far away; its pose, and the file."""
    rng, T = np.random.default_rng(5), leaning(0.014, 1.5, 0.7)
    shown = *standing(rng, (0.52, 0.0), BAR), block(rng, (0.5, 0.3), CARTON)
    return T, file_of(seen_at(rng, T, *shown), near=(0.52, 0.0, 0.03))


def moved_tables(count, seed):
    """Poses of tables, -20 to 30 mm higher and leaning by up to 4 degrees, each with a cloud of a box there."""
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        T = leaning(rng.uniform(-0.02, 0.03), rng.uniform(0.0, 4.0), rng.uniform(0.0, 2.0 * np.pi))
        sides = rng.uniform((0.03, 0.05, 0.015), (0.07, 0.15, 0.15))
        place = rng.uniform((0.46, -0.1), (0.56, 0.1))
        yield T, seen_at(rng, T, *standing(rng, place, sides), noise=rng.uniform(0.0003, 0.002))


@pytest.mark.parametrize("count", [4, pytest.param(200, marks=pytest.mark.slow)])
def test_no_shape_of_the_hand_is_in_the_table_that_was_seen(count):
    reached = 0
    for k, (T, points) in enumerate(moved_tables(count, 0)):
        content = file_of(points, seed=k)
        if isinstance(content, str):
            assert content, "a refusal says why"
            continue
        reached += 1
        assert height_over(content, T) > 0.0, k
    assert reached > 0.7 * count


def test_a_file_states_the_table_and_is_held_to_its_points():
    T, content = bar_on_a_higher_table()
    assert height_over(content, T) > 0.0
    assert np.allclose(content["table"]["normal"], T[:3, 2], atol=2e-3)
    record = record_of(content)
    assert rejected(record) == []
    names = {check.name for check in verify(record)}
    assert {"clearance hand_seen", "pregrasp clearance hand_seen", "lift: clearance hand_seen"} <= names
    assert as_json(record)["table"] == content["table"]
    carton = np.array(content["table"]["around"]) - T[:3, 3]
    assert np.ptp(carton @ T[:3, :3], axis=0) == pytest.approx(np.array(CARTON), abs=0.01)
    parts = record.placed(record.here.T_base_world).parts
    assert np.allclose(np.concatenate(parts), np.concatenate(content["parts"]), atol=1e-12)


def higher(content):
    """Points and plane agree, but the hand is in them."""
    table = content["table"]
    table["points"] = (np.array(table["points"]) + 0.01 * np.array(table["normal"])).tolist()
    table["offset"] += 0.01


def in_a_tip(content):
    point, normal = (np.array(content["contacts"][0][key]) for key in ("point", "normal"))
    content["table"]["around"].append((point + 0.01 * normal).tolist())


@pytest.mark.parametrize(
    ("change", "refused"),
    [
        (
            lambda c: c["table"].update(offset=c["table"]["offset"] + 0.002),
            {"offset of the table as seen as stated"},
        ),
        (lambda c: c["table"]["points"][0].__setitem__(2, 0.05), {"normal of the table as seen as stated"}),
        (higher, {"clearance hand_table", "clearance hand_seen"}),
        (in_a_tip, {"clearance hand_seen"}),
    ],
)
def test_a_table_that_is_tampered_with_is_refused(change, refused):
    content = copy.deepcopy(bar_on_a_higher_table()[1])
    change(content)
    assert refused <= set(rejected(record_of(content)))
    content["table"]["normal"].reverse()
    with pytest.raises(Exception, match="points up"):
        record_of(content)


def test_a_trajectory_is_checked_against_the_table_that_was_seen(tmp_path):
    _, content = bar_on_a_higher_table()
    export_grasp(record_of(content), tmp_path, "json")
    recording = read_trajectory(tmp_path, CELL)
    assert recording.facts.table is not None
    checks = {check.name: check.holds for check in check_trajectory(recording, CELL)}
    assert checks["robot to the points that were seen (m)"]
    assert all(checks.values())


def test_the_robot_at_a_seen_table_is_the_one_that_would_be_compiled_there():
    rng = np.random.default_rng(1)
    T = leaning(0.02, 3.0, 0.5)
    there = CELL.seeing(SeenTable.of(flat(rng, (0.4, -0.1), (0.6, 0.1)) @ T[:3, :3].T + T[:3, 3]))
    fresh, moved = robot_spec(there).compile(), compiled_robot(there)
    for name in ("body_pos", "body_quat", "geom_pos", "geom_quat", "site_pos", "jnt_axis"):
        assert_array_equal(getattr(moved, name), getattr(fresh, name))
    tree, before = robot_tree(there), robot_tree(CELL)
    assert not np.array_equal(tree.rotation[0], before.rotation[0])
    assert_array_equal(tree.rotation[1:], before.rotation[1:])


def test_a_table_elsewhere_is_said_with_both_figures():
    rng = np.random.default_rng(3)
    shown = standing(rng, (0.5, 0.05), CARTON)
    said = find(seen_at(rng, leaning(0.018), *shown)).table.differs(0.0)
    assert "z = 0.019 m" in said or "z = 0.018 m" in said
    assert "0.000 m" in said
    assert "tilted" not in said
    assert "tilted by 2." in find(seen_at(rng, leaning(0.0, 2.5), *shown)).table.differs(0.0)
    assert find(seen_at(rng, leaning(0.0), *shown)).table.differs(0.0) == ""
    assert find(seen_at(rng, leaning(0.07), *shown)).reason == "table_not_at_base_height"


@pytest.mark.parametrize("degrees", [2.5, 6.0])
@pytest.mark.parametrize("about", [AMID, np.zeros(3)])
def test_every_lean_is_levelled_alike(degrees, about):
    rng = np.random.default_rng(int(10 * degrees))
    T = leaning(0.0, degrees, 0.4, about)
    found = find(seen_at(rng, T, *standing(rng, (0.52, 0.0), CARTON)))
    assert found.reason is None
    assert np.degrees(found.table.lean) == pytest.approx(degrees, abs=0.2)
    assert np.degrees(np.arccos(found.table.normal @ T[:3, 2])) < 0.2
    world = CELL.seeing(found.table).T_world_base
    corner = T[:3, :3] @ [0.55, 0.045, 0.12] + T[:3, 3]  # a corner of the carton, as the robot has it
    top = found.target.points.max(0)
    assert np.abs(world[:3, :3] @ corner + world[:3, 3] - top).max() < 0.006


def beside_a_plate(rng):
    """A table with a carton, and a plate 2 cm higher that is nearly as large."""
    low = without(flat(rng, (0.2, -0.05), (0.85, 0.45)), (0.5, 0.1), CARTON)
    return [low, flat(rng, (0.2, -0.45), (0.85, -0.05), 0.02), block(rng, (0.5, 0.1), CARTON)], 0.0


def on_a_plate(rng):
    """A carton on a plate of 30 x 32 cm, 2.5 cm above a table that is larger."""
    table = without(flat(rng, (0.2, -0.45), (0.85, 0.45)), (0.5, 0.1), (0.30, 0.32))
    plate = without(flat(rng, (0.35, -0.06), (0.65, 0.26), 0.025), (0.5, 0.1), CARTON)
    return [table, plate, block(rng, (0.5, 0.1), CARTON, 0.025)], 0.025


def before_a_ramp(rng):
    """A table with a carton; towards the robot a ramp of 5 degrees goes up."""
    ramp = flat(rng, (0.0, -0.4), (0.4, 0.4))
    ramp[:, 2] = np.tan(np.radians(5.0)) * (0.4 - ramp[:, 0])
    return [ramp, *standing(rng, (0.55, 0.0), CARTON, low=(0.4, -0.4))], 0.0


def under_a_shelf(rng, height=0.45):
    """A table with a carton, below a board."""
    return [*standing(rng, (0.5, 0.0), CARTON), flat(rng, (0.3, -0.3), (0.8, 0.3), height, 0.008)], 0.0


SCENES = (beside_a_plate, on_a_plate, before_a_ramp, under_a_shelf)


@pytest.mark.parametrize("noise", [0.0005, 0.003])
@pytest.mark.parametrize("scene", SCENES)
def test_the_table_is_the_plane_under_the_object(scene, noise):
    rng = np.random.default_rng(11)
    surfaces, height = scene(rng)
    points = seen_at(rng, leaning(0.0), *surfaces, noise=noise)
    for seed in range(2):
        table = find(points, seed, near=(0.5, 0.05, 0.08)).table
        assert table is not None
        above = table.height(np.array([0.5, 0.05])) - height
        assert -0.0005 < above < 0.001 + 1.5 * noise, (seed, above)
        assert np.degrees(table.lean) < 0.3


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("step", "noise"), [(0.01, 0.0025), (0.03, 0.001)])
def test_a_table_of_two_levels_is_not_bridged(step, side, noise):
    """The carton stands on the lower half or on the upper one."""
    rng, place = np.random.default_rng(8), (0.5, 0.15 * side)
    halves = flat(rng, (0.2, -0.45), (0.85, 0.0)), flat(rng, (0.2, 0.0), (0.85, 0.45), step)
    foot = step if side > 0.0 else 0.0
    shown = [*(without(half, place, CARTON) for half in halves), block(rng, place, CARTON, foot)]
    found = find(seen_at(rng, leaning(0.0), *shown, noise=noise))
    assert found.reason is None
    assert -0.0005 < found.table.height(np.array(place)) - foot < 0.003
    assert np.degrees(found.table.lean) < 0.15
    assert bool(found.boxes) == (side < 0.0)


def test_what_is_level_beside_or_above_is_an_obstacle():
    rng = np.random.default_rng(4)
    shelf = partial(under_a_shelf, height=0.8)
    for scene, wanted in ((beside_a_plate, (0.6, -0.2, 0.01)), (shelf, (0.6, 0.2, 0.8))):
        points = seen_at(rng, leaning(0.0), *scene(rng)[0])
        found = find(points)
        assert found.reason is None, scene
        assert not found.neighbours
        corners = [(box.min(0), box.max(0)) for box in found.boxes]
        assert any(((low < wanted) & (high > wanted)).all() for low, high in corners)
        middle = found.target.points.mean(0)
        assert not any(((low < middle) & (high > middle)).all() for low, high in corners)
        assert not isinstance(file_of(points), str)


@pytest.mark.skipif(not GIVEN.is_dir(), reason="clouds of others are not here")
@pytest.mark.parametrize(("name", "height", "lean"), table("tables_seen"))
def test_given_clouds_are_planned_clear_of_their_table(name, height, lean):
    points = read_scan(GIVEN / f"{name}.ply")
    table = find_object(points, np.random.default_rng(0), CELL).table
    assert -0.001 < table.height(AMID[:2]) - height < 0.004
    assert np.degrees(table.lean) == pytest.approx(lean, abs=0.2)
    content = file_of(points)
    assert rejected(record_of(content)) == []
    if lean < 1.0:
        T = np.eye(4)
        T[2, 3] = np.median(table.points[:, 2])
        assert height_over(content, T) > 0.0
