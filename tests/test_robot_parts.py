"""What `robot make` reads of a description: torques and stiffnesses through gears, and which joints an arm may have."""

import locale
import re
import shutil
import subprocess

import numpy as np
import pytest
import trimesh
import yaml
from foreign_parts import six_joint_arm
from processes import typed
from refusals import refused
from tables import mistakes, table

from dexgrasp_env.robot.make import arm_entry, make_robot
from dexgrasp_env.robot.model import excluded_pairs, posed
from dexgrasp_env.robot.postures import _room
from dexgrasp_env.robot.rebuilt import Description, compiled
from dexgrasp_env.robot.robot_file import make_arm


def driven(folder, servos, change=lambda text: text):
    """Write the arm of six joints with servos; return its path."""
    path = six_joint_arm(folder)
    text = path.read_text().replace("</mujoco>", f"<actuator>{servos}</actuator></mujoco>")
    path.write_text(change(text))
    return path


@pytest.mark.parametrize(("servo", "torque", "stiffness"), table("servos"))
def test_torque_and_stiffness_are_the_joints(servo, torque, stiffness, tmp_path):
    path = driven(tmp_path, "".join(servo.format(k=k) for k in range(6)))
    entry, notes = arm_entry(path)
    assert entry["name"] == "six"  # as its file: it has none itself
    assert entry["torque"] == pytest.approx([torque] * 6)
    assert entry["stiffness"] == pytest.approx([stiffness] * 6)
    assert any("stiffness" in note for note in notes) == (stiffness == 2000.0)


def test_joints_without_a_range_turn_once(tmp_path):
    path = six_joint_arm(tmp_path)
    path.write_text(path.read_text().replace(' range="-3.1 3.1"', "", 2))
    make_robot(None, path, tmp_path / "six.yaml")
    arm = yaml.safe_load((tmp_path / "six_arm.yaml").read_text())
    assert np.allclose(arm["upper"], [np.pi, np.pi, 3.1, 3.1, 3.1, 3.1], atol=1e-5)
    assert typed(f"robot check {tmp_path / 'six.yaml'} --json") in (0, 1)


def test_an_arm_is_mounted_where_its_flange_is_and_begins_with_room_for_a_hand(tmp_path):
    path = six_joint_arm(tmp_path)
    entry, _ = arm_entry(path)
    arm = make_arm(entry)
    model = compiled(arm)
    # Its base may overlap the link on it, as neighbours do.
    assert excluded_pairs(model) == {frozenset((model.body("stand").id, model.body("link0").id))}
    beside = [-2.81, -1.34, 1.16, 1.75, -1.57, 0.55]  # the forearm is beside the hand
    assert _room(arm, posed(model, beside)) < -5.0 < _room(arm, posed(model, entry["home"]))
    path.write_text(path.read_text().replace("</body>", '<site name="y_axis" pos="0 0.09 0"/></body>', 1))
    assert arm_entry(path)[0]["frame"] == entry["frame"]
    jaw = '<body name="jaw"><joint name="jaw" axis="1 0 0" range="0 1"/><geom size="0.02"/></body><site name="flange"'
    path.write_text(path.read_text().replace('<site name="flange"', jaw))
    assert arm_entry(path)[0]["joints"] == entry["joints"]


@pytest.mark.parametrize(("pattern", "by", "words"), mistakes("arms"))
def test_an_arm_of_other_joints_is_refused_in_a_line(pattern, by, words, tmp_path):
    path = six_joint_arm(tmp_path)
    path.write_text(re.sub(pattern, by, path.read_text()))
    with refused(words):
        arm_entry(path)


@pytest.fixture
def french(tmp_path, monkeypatch):
    """Set a locale with decimal commas for the time of a test."""
    made = shutil.which("localedef") and subprocess.run(
        ["localedef", "-i", "fr_FR", "-f", "UTF-8", str(tmp_path / "fr_FR.UTF-8")], capture_output=True
    )
    monkeypatch.setenv("LOCPATH", str(tmp_path))
    before = locale.setlocale(locale.LC_ALL)
    try:
        locale.setlocale(locale.LC_ALL, "fr_FR.UTF-8")
    except locale.Error:
        pytest.skip(f"no French locale can be made here: {made}")
    yield
    locale.setlocale(locale.LC_ALL, before)


def test_meshes_of_a_hand_are_as_large_where_commas_are_decimal(french, tmp_path):
    trimesh.creation.box((0.02, 0.03, 0.05)).export(tmp_path / "palm.obj")
    (tmp_path / "hand.xml").write_text(
        "<mujoco><asset><mesh name='palm' file='palm.obj'/></asset>"
        "<worldbody><geom type='mesh' mesh='palm'/></worldbody></mujoco>"
    )
    model = Description(tmp_path / "hand.xml").model
    assert sorted(model.geom_aabb[0, 3:]) == pytest.approx([0.01, 0.015, 0.025])
    assert locale.localeconv()["decimal_point"] == ","
