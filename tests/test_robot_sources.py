"""Descriptions as makers ship them: each kind one small file, read without being told anything."""

import re

import mujoco
import pytest
import yaml

from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.robot.make import make_robot
from dexgrasp_env.robot.source import read_source

FINGERS = {  # name: origin, roll pitch yaw, range of the flexing joint, and how far the first one spreads
    "fore": ("0 0.03 0", "0 0 0", (0, 1.6), 0.5),
    "mid": ("0 -0.03 0", "0 0 0", (0, 1.6), 0.5),
    "thumb": ("0.01 0 -0.08", "-1.5707963 0 -1.5707963", (-0.8, 1.2), 0.5),
}
LINK = (
    '<link name="{name}"><inertial><mass value="{mass}"/><inertia ixx="{ixx}" iyy="1e-5" izz="1e-5" ixy="0" ixz="0"'
    ' iyz="0"/></inertial><{tag}><origin xyz="0 0 {z}"/><geometry>{shape}</geometry></{tag}></link>'
)
JOINT = (
    '<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
    '<limit lower="{low}" upper="{high}" effort="1.5" velocity="{rate}"/>{mimic}</joint>'
)


def urdf(tag="collision", shape=None, ixx="1e-5", mimic=False, prefix=(), fingers=FINGERS):
    """Return a hand of fingers of three joints as URDF text."""

    def link(name, length, mass=0.03):
        rod = f'<cylinder radius="0.01" length="{length}"/>'
        return LINK.format(name=name, mass=mass, ixx=ixx, tag=tag, z=length / 2, shape=shape or rod)

    parts = [*prefix, LINK.format(name="plate", mass=0.4, ixx="1e-3", tag=tag, z=-0.05,
                                  shape='<box size="0.024 0.09 0.1"/>').replace("1e-5", "1e-3")]  # fmt: skip
    for name, (xyz, rpy, (low, high), spread) in fingers.items():
        parts += [link(f"{name}_base", 0.02), link(f"{name}_near", 0.055), link(f"{name}_far", 0.045)]
        follow = f'<mimic joint="{name}_flex" multiplier="0.8" offset="0.1"/>' if mimic else ""
        rows = (
            ("spread", "plate", "base", xyz, rpy, "1 0 0", -spread, spread, ""),
            ("flex", f"{name}_base", "near", "0 0 0.02", "0 0 0", "0 1 0", low, high, ""),
            ("curl", f"{name}_near", "far", "0 0 0.055", "0 0 0", "0 1 0", 0, 1.6, follow),
        )
        for joint, parent, child, xyz_, rpy_, axis, low_, high_, mimic_ in rows:
            parts.append(
                JOINT.format(name=f"{name}_{joint}", parent=parent, child=f"{name}_{child}", xyz=xyz_, rpy=rpy_,
                             axis=axis, low=low_, high=high_, rate=4.0, mimic=mimic_)
            )  # fmt: skip
    return f'<?xml version="1.0"?><robot name="claw">{"".join(parts)}</robot>'


def mjcf(folder, edit=None, **kwargs):
    """Write the same hand as MJCF, its XML text edited, and return the path."""
    spec = mujoco.MjSpec.from_string(
        urdf(**kwargs).replace("</robot>", '<mujoco><compiler fusestatic="false"/></mujoco></robot>')
    )
    spec.compile()
    text = spec.to_xml()
    path = folder / "claw.xml"
    path.write_text(edit(text) if edit else text)
    return path


def hand_of(folder, path):
    """Return what `make` notes of a hand, and its file."""
    notes = make_robot(path, None, folder / "claw.yaml")
    return notes, yaml.safe_load((folder / "claw_hand.yaml").read_text())


def test_a_urdf_keeps_the_torques_and_velocities_it_states(tmp_path):
    path = tmp_path / "claw.urdf"
    path.write_text(urdf())
    _, hand = hand_of(tmp_path, path)
    tips = {f["name"]: f["bodies"][-1] for f in hand["fingers"]}
    assert (tips[hand["grasp"][0]], hand["palm"]) == ("thumb_far", "plate")
    assert hand["velocity"] == [4.0] * 9
    assert hand["torque"] == [1.5] * 9
    assert make_cell(str(tmp_path / "claw.yaml")).robot.dof == 7 + 9


def test_mimics_become_couplings_and_the_open_posture_obeys_them(tmp_path):
    path = tmp_path / "claw.urdf"
    path.write_text(urdf(mimic=True))
    notes, hand = hand_of(tmp_path, path)
    found = {own["joint"]: (own["follows"], own["ratio"], own["offset"]) for own in hand["couplings"]}
    assert found == {f"{name}_curl": (f"{name}_flex", 0.8, 0.1) for name in FINGERS}
    names = [joint for finger in hand["fingers"] for joint in finger["joints"]]
    at = dict(zip(names, hand["open"], strict=True))
    assert all(abs(at[f"{n}_curl"] - 0.8 * at[f"{n}_flex"] - 0.1) < 1e-3 for n in FINGERS)
    assert any("couplings" in note for note in notes)


def test_a_fixed_tendon_without_slack_couples_its_two_joints(tmp_path):
    tendon = (
        '<tendon><fixed limited="true" range="-0.001 0.001"><joint joint="fore_curl" coef="0.008"/>'
        '<joint joint="fore_flex" coef="-0.007"/></fixed></tendon>'
        '<equality><joint joint1="mid_curl" joint2="mid_flex" active="false"/></equality></mujoco>'
    )
    _, hand = hand_of(tmp_path, mjcf(tmp_path, lambda text: text.replace("</mujoco>", tendon)))
    (own,) = hand["couplings"]  # and none of the equality, which is switched off
    assert (own["joint"], own["follows"]) == ("fore_curl", "fore_flex")
    assert own["ratio"] == pytest.approx(7 / 8)


def test_meshes_are_found_by_package_and_relative_to_the_file(tmp_path):
    import trimesh

    folder = tmp_path / "claw_description"
    (folder / "meshes").mkdir(parents=True)
    (folder / "urdf").mkdir()
    trimesh.creation.box((0.02, 0.02, 0.05)).export(folder / "meshes" / "rod.stl")
    for name in ("package://claw_description/meshes/rod.stl", "../meshes/rod.stl", "meshes/rod.stl"):
        path = folder / "urdf" / "claw.urdf"
        path.write_text(urdf(shape=f'<mesh filename="{name}"/>'))
        assert read_source(path).model.nmesh > 0
    path.write_text(urdf(shape='<mesh filename="package://other/none.stl"/>'))
    with pytest.raises(InputError, match=r"mesh 'package://other/none.stl' of link 'fore_base' is not found"):
        read_source(path)


def test_a_description_without_collision_shapes_collides_with_what_is_seen(tmp_path):
    path = tmp_path / "claw.urdf"
    path.write_text(urdf(tag="visual"))
    notes, _ = hand_of(tmp_path, path)
    assert any("visual shapes" in note for note in notes)


@pytest.mark.parametrize("ixx", ["1", "-1e-5"])
def test_inertias_that_no_body_has_are_mended_or_taken_from_the_shapes(tmp_path, ixx):
    path = tmp_path / "claw.urdf"
    path.write_text(urdf(ixx=ixx))
    assert read_source(path).model.njnt == 9


def test_attributes_of_another_version_floors_and_floating_roots_are_left_out(tmp_path):
    def edit(text):
        text = text.replace(
            "<worldbody>", '<option apirate="20"/><worldbody><geom type="plane" size="1 1 1"/>'
        )
        return text.replace('<body name="plate">', '<body name="plate"><freejoint/>')

    source = read_source(mjcf(tmp_path, edit))
    assert not (source.model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE).any()
    assert source.model.njnt == 9
    assert [word for word in ("apirate", "floor", "floats") if any(word in n for n in source.notes)] == [
        "apirate", "floor", "floats",
    ]  # fmt: skip


def test_a_palm_that_is_the_world_becomes_a_body(tmp_path):
    def edit(text):
        text = re.sub(r'<body name="plate">\s*<inertial[^>]*>', "", text, count=1)
        return text[::-1].replace(">ydob/<", "", 1)[::-1]

    notes, hand = hand_of(tmp_path, mjcf(tmp_path, edit))
    assert hand["palm"] == "base"
    assert any("'base'" in note for note in notes)
    named = lambda text: edit(text).replace('"fore_base"', '"base"')  # noqa: E731
    assert hand_of(tmp_path, mjcf(tmp_path, named))[1]["palm"] == "base_base"


def test_a_floating_base_of_a_urdf_is_fixed(tmp_path):
    base = '<joint name="floats" type="floating"><parent link="world"/><child link="plate"/></joint>'
    (tmp_path / "claw.urdf").write_text(urdf(prefix=('<link name="world"/>', base)))
    source = read_source(tmp_path / "claw.urdf")
    assert source.model.njnt == 9
    assert any("'floats' floats: it is fixed" in note for note in source.notes)


def test_an_arm_and_a_hand_in_one_file_are_parted_where_fingers_branch(tmp_path):
    arm, above = [], "stand"
    arm.append(
        LINK.format(name=above, mass=1, ixx="1e-2", tag="collision", z=0.0, shape='<sphere radius="0.04"/>')
    )
    axes = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0")
    offsets = ("0 0 0.16", "0 0.13 0", "0 -0.12 0.42", "0 0 0.39", "0 0.12 0", "0 0 0.1")
    for k, (axis, xyz) in enumerate(zip(axes, offsets, strict=True)):
        rod = '<sphere radius="0.035"/>'
        arm.append(LINK.format(name=f"l{k}", mass=1, ixx="1e-2", tag="collision", z=0.0, shape=rod))
        arm.append(JOINT.format(name=f"a{k}", parent=above, child=f"l{k}", xyz=xyz, rpy="0 0 0", axis=axis, low=-3,
                                high=3, rate=2.0, mimic=""))  # fmt: skip
        above = f"l{k}"
    arm = [part.replace("1e-5", "1e-2") for part in arm]
    arm.append(
        f'<joint name="flange" type="fixed"><parent link="{above}"/><child link="plate"/>'
        '<origin xyz="0 0.12 0" rpy="-1.5707963 0 0"/></joint>'
    )
    path = tmp_path / "both.urdf"
    path.write_text(urdf(prefix=arm))
    make_robot(path, path, tmp_path / "both.yaml")
    robot = make_cell(str(tmp_path / "both.yaml")).robot
    assert robot.arm.joints.names == tuple(f"a{k}" for k in range(6))
    assert len(robot.hand.joints.names) == 9
    assert robot.hand.palm == "plate"
