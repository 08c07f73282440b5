"""Exported trajectories: within limits, read back by other code, and refused where they are wrong."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from processes import typed
from refusals import refused
from robots import ARM_JOINTS, CELL, HAND_JOINTS, HOME, LOWER, ROBOT, UPPER
from tables import table

from dexgrasp.cli.codes import ANSWER_IS_NO, BAD_INPUT, OK
from dexgrasp.export.check import check_trajectory
from dexgrasp.export.formats import moveit_grasp, write_csv, write_json, write_ros2, write_scene
from dexgrasp.export.grasp_export import export_grasp
from dexgrasp.export.read import read_trajectory
from dexgrasp.export.replay import replay
from dexgrasp.export.trajectory import ARM_TICK, Limits, Waypoints, make_trajectory, timed
from dexgrasp.grasp.file import record_of
from dexgrasp.grasp.trajectory import limit_shares
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.poses import rigid
from dexgrasp_env.scene.build import build_scene
from dexgrasp_env.yaml_file import read_yaml

ROOT = Path(__file__).parents[1]
LIMITS = Limits(np.full(4, 2.0), np.full(4, 10.0), np.full(4, 5000.0))
AWAY = [[x, y, z] for x in (0.5, 0.54) for y in (0.5, 0.54) for z in (0.0, 0.04)]
FACTS = {
    "mount": "palm_normal", "cell": CELL.stamp, "object": "a block away", "parts": [AWAY], "around": [],
    "rejected": [],
}  # fmt: skip


def waypoints():
    """A short motion near home that touches nothing."""
    start, pregrasp = np.array(HOME), np.array(HOME)
    pregrasp[:7] += [0.2, 0.1, -0.1, 0.1, 0.1, -0.1, 0.3]
    grasp, squeeze = pregrasp.copy(), pregrasp.copy()
    grasp[8] += 0.1
    squeeze[8] += 0.15
    middle = 0.5 * (start + pregrasp)
    middle[2] += 0.05
    lift = squeeze + np.linspace(0.0, 1.0, 12)[:, None] * np.r_[0.0, -0.1, 0.0, 0.1, np.zeros(19)]
    return Waypoints(np.stack([start, middle, pregrasp]), grasp, squeeze, lift)


@pytest.fixture(scope="module")
def trajectory():
    return make_trajectory(waypoints(), ROBOT)


@pytest.fixture
def folder(trajectory, tmp_path):
    write_csv(tmp_path, trajectory, FACTS)
    return tmp_path


def test_the_arm_has_its_makers_limits():
    """Typed again: trajectories are held to the robot's file alone."""
    limits = table("panda")
    assert {name: list(getattr(ROBOT.arm.joints, name)) for name in limits} == limits


@pytest.mark.parametrize("seed", range(5))
def test_laws_keep_the_limits_and_reach_the_end(seed):
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(0.0, 0.2, (rng.integers(2, 9), 4)), axis=0)
    rows = timed(path, LIMITS)
    assert len(rows) % 3 == 0
    assert np.array_equal(rows[-1], path[-1])
    shares = np.array(limit_shares(np.concatenate([path[:1], rows]), 0.001, *LIMITS))
    assert max(shares) < 0.95
    assert shares[:2].max() > 0.2  # not just slow


def test_a_way_along_the_ends_of_joint_ranges_stays_inside():
    way = waypoints()
    bent = np.array([way.approach[0]] * 6)
    bent[:, :7] += np.linspace(0.0, 0.3, 6)[:, None]
    bent[2:, 12], bent[2:, 20] = UPPER[12], LOWER[20]  # reached within one step, and kept
    ends = [bent[-1], bent[-1]]
    made = make_trajectory(
        Waypoints(bent, *ends, np.stack([ends[1], ends[1] + np.r_[0.0, -0.05, np.zeros(21)]])), ROBOT
    )
    for rows, part in ((made.arm, slice(0, 7)), (made.hand, slice(7, 23))):
        assert (rows >= LOWER[part]).all()
        assert (rows <= UPPER[part]).all()


def broken(folder):
    """Names of the checks that fail."""
    found = check_trajectory(read_trajectory(folder, CELL), CELL)
    assert len(found) > 10
    return "; ".join(check.name for check in found if not check.holds)


def test_a_good_trajectory_passes_unless_its_grasp_was_rejected(trajectory, folder):
    assert broken(folder) == ""
    write_csv(folder, trajectory, FACTS | {"rejected": ["load"]})
    assert broken(folder) == "grasp: checks of verify that fail"


def test_every_format_holds_the_same_rows(trajectory, folder, tmp_path):
    write_json(tmp_path / "json", trajectory, FACTS)
    for found in (read_trajectory(written, CELL) for written in (folder, tmp_path / "json")):
        assert np.array_equal(found.arm.positions, trajectory.arm)
        assert np.array_equal(found.hand.positions, trajectory.hand)


@pytest.mark.parametrize(("column", "change", "found"), table("changed_numbers"))
def test_one_changed_number_is_found(folder, column, change, found):
    lines = (folder / "arm.csv").read_text().splitlines()
    row = lines[900].split(",")
    row[1 + column] = f"{change + (column != 5) * float(row[1 + column]):.17g}"
    (folder / "arm.csv").write_text("\n".join([*lines[:900], ",".join(row), *lines[901:]]) + "\n")
    assert found in broken(folder)


def test_a_missing_row_and_a_hand_in_the_table_are_found(trajectory, folder):
    deep = trajectory.arm.copy()
    deep[:, 1] += 1.6 * np.linspace(0.0, 1.0, len(deep))
    write_csv(folder, replace(trajectory, arm=deep), FACTS)
    lines = (folder / "hand.csv").read_text().splitlines()
    (folder / "hand.csv").write_text("\n".join(lines[:100] + lines[101:]) + "\n")
    found = broken(folder)
    assert "times" in found
    assert "table" in found


def test_a_trajectory_without_what_is_said_beside_it_is_refused(folder):
    path = folder / "segments.json"
    whole = json.loads(path.read_text())
    wrong = {
        "segments": [whole["segments"][:3], [{"name": "lift"}] * 4, whole["segments"][::-1]],
        "parts": [[], [[["a", 0, 0]] * 4]],
        "around": [None, [AWAY[:3]]],
        "mount": [["palm_normal"]],
    }
    for key, values in wrong.items():
        without = {name: value for name, value in whole.items() if name != key}
        for content in (without, *(whole | {key: value} for value in values)):
            path.write_text(json.dumps(content))
            with refused(key.rstrip("s")):
                read_trajectory(folder, CELL)
    path.unlink()
    with refused("segments.json is missing"):
        read_trajectory(folder, CELL)


@pytest.mark.parametrize("name", ["approach", "lift"])
def test_segments_that_do_not_follow_each_other_are_found(folder, name):
    path = folder / "segments.json"
    content = json.loads(path.read_text()) | {"around": [[[x, y + 0.2, z] for x, y, z in AWAY]]}
    for segment in content["segments"]:
        segment |= {"start": 1e6} if segment["name"] == name else {}
    path.write_text(json.dumps(content))
    assert broken(folder) == "segments follow each other to the end, off by (s)"


def test_damaged_files_are_one_line(folder, tmp_path):
    text = (folder / "arm.csv").read_text()
    wrong = {
        "header": text.replace("panda_joint1", "joint_1", 1),
        "words": text.replace("\n0.001", "\nabc", 1),
        "nan": text.replace("\n0.002000,", "\nnan,", 1),
    }
    for content in wrong.values():
        (folder / "arm.csv").write_text(content)
        with refused():
            read_trajectory(folder, CELL)
    with refused():
        read_trajectory(tmp_path / "nothing", CELL)


def test_a_scene_that_is_none_is_one_line(folder):
    found, scene = read_trajectory(folder, CELL), folder / "scene.xml"
    with refused("export --format mjcf"):
        replay(found, scene)
    scene.write_text("<mujoco/>")
    with refused():
        replay(found, scene)


def test_ros_messages_have_their_fields(trajectory, tmp_path):
    facts = FACTS | {
        "open": HOME[7:].tolist(), "closed": HOME[7:].tolist(), "quality": 0.5, "lift_height": 0.14,
        "largest_force": 9.0, "squeeze": {"torque": [0.1] * 16},
        "palm": {"position": [0.5, 0.0, 0.2], "quat_wxyz": [1.0, 0.0, 0.0, 0.0]},
    }  # fmt: skip
    write_ros2(tmp_path, trajectory, facts)
    arm, hand, grasp = (read_yaml(tmp_path / f"{name}.yaml") for name in ("arm", "hand", "grasp"))
    assert arm["joint_names"] == list(ARM_JOINTS)
    last = arm["points"][-1]["time_from_start"]
    assert -1e-9 < last["sec"] + 1e-9 * last["nanosec"] - ARM_TICK * (len(trajectory.arm) - 1) < 0.011
    for message, rows in ((arm, trajectory.arm), (hand, trajectory.hand)):
        assert message["points"][-1]["positions"] == rows[-1].tolist()
    assert len(arm["points"][0]["velocities"]) == 7
    assert grasp == json.loads(json.dumps(moveit_grasp(facts, "panda_link0", HAND_JOINTS)))


def test_the_scene_loads_elsewhere_and_is_the_same(trajectory, tmp_path):
    shape = load_object("sugar_box")
    write_scene(tmp_path / "here", shape, np.eye(4), CELL)
    shutil.move(tmp_path / "here", tmp_path / "there")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "there" / "scene.xml"))
    own = build_scene(shape, CELL)
    for name in table("kept_in_the_scene"):
        assert np.allclose(getattr(model, name), getattr(own, name), atol=1e-6), name
    write_csv(tmp_path, trajectory, FACTS)
    outcome = replay(
        read_trajectory(tmp_path, CELL), tmp_path / "there" / "scene.xml", np.random.default_rng(0)
    )
    assert not outcome.success  # nothing was grasped


def test_replays_that_do_not_hold_are_no_and_said_last(contents, tmp_path, capsys):
    export_grasp(record_of(contents["tomato_soup_can"]), tmp_path, "mjcf")
    check = f"check {tmp_path} --replay 2"
    assert typed(check) == OK
    assert "every check holds; held in 2 of 2" in capsys.readouterr().out.splitlines()[-1]
    write_scene(tmp_path, load_object("tomato_soup_can"), rigid(np.eye(3), [0.5, 0.4, 0.06]), CELL)
    assert typed(check) == ANSWER_IS_NO  # the can stands elsewhere
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("NOT fit to run; held in 0 of 2")
    assert last.endswith("9/10 are needed")
    assert typed(f"{check} --json --need 1/3") == ANSWER_IS_NO
    assert json.loads(capsys.readouterr().out)["holds"] is False
    assert typed(f"{check} --need 0/1") == OK
    for wrong in ("2/1", "0.9", "1/2 --replay 0"):
        assert typed(f"{check} --need {wrong}") == BAD_INPUT


def test_the_page_for_robots_reads_what_is_written_and_presses_once(contents, tmp_path):
    export_grasp(record_of(contents["sugar_box"]), tmp_path, "ros2")
    facts = json.loads((tmp_path / "segments.json").read_text())
    page: dict = {}
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "run-on-your-robot.md").read_text(), re.S)
    exec(block, page)
    names, times, arm = page["read_rows"](tmp_path / "arm.csv")
    assert tuple(names) == ARM_JOINTS
    page["check_start"](arm[0] + 0.005, arm)
    with pytest.raises(SystemExit, match=r"joint 2 stands 0.020 rad from the first row"):
        page["check_start"](arm[0] + 0.02 * np.eye(7)[1], arm)
    names, times, hand = page["read_rows"](tmp_path / "hand.csv")
    assert tuple(names) == HAND_JOINTS
    assert facts["squeeze"]["joints"] == list(HAND_JOINTS)
    closed = next(segment["end"] for segment in facts["segments"] if segment["name"] == "close")
    assert_allclose(hand[np.argmin(np.abs(times - closed))], facts["touching"], atol=4e-3)
    assert_allclose(hand[-1], facts["closed"], atol=4e-3)
    pressed = np.add(facts["touching"], facts["squeeze"]["offset"])
    assert_allclose(pressed, facts["closed"], atol=1e-6)
