"""Descriptions as makers ship them: each kind one small file, read without being told anything."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import trimesh
import yaml
from numpy.testing import assert_allclose
from planned import lying
from refusals import refused
from tables import table

from dexgrasp.mechanics.kinematics.clearance import SELF
from dexgrasp.mechanics.kinematics.forward import fingertips
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.planning import atlas, certificate_builder
from dexgrasp.planning.postures import atlas_postures
from dexgrasp.planning.proposals import SurfaceProposals
from dexgrasp.planning.settings import GraspProblem, PlannerSettings
from dexgrasp.planning.sqp import solve
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.robot.hand_maker import HandMaker
from dexgrasp_env.robot.make import make_robot, parts_of
from dexgrasp_env.robot.part import NamedParts
from dexgrasp_env.robot.postures import put_aside
from dexgrasp_env.robot.rebuilt import compiled, described
from dexgrasp_env.robot.robot_file import make_hand
from dexgrasp_env.robot.source import read_source

FINGERS = table("fingers")
LINK = (
    '<link name="{name}"><inertial><mass value="{mass}"/><inertia ixx="{ixx}" iyy="1e-5" izz="1e-5" ixy="0" ixz="0"'
    ' iyz="0"/></inertial><{tag}><origin xyz="0 0 {z}"/><geometry>{shape}</geometry></{tag}></link>'
)
JOINT = (
    '<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
    '<limit lower="{low}" upper="{high}" effort="1.5" velocity="{rate}"/>{mimic}</joint>'
)


def urdf(tag="collision", shape=None, mimic=False, prefix=(), fingers=FINGERS):
    """Return a hand of fingers of three joints as URDF text."""

    def link(name, length, mass=0.03):
        rod = f'<cylinder radius="0.01" length="{length}"/>'
        return LINK.format(name=name, mass=mass, ixx="1e-5", tag=tag, z=length / 2, shape=shape or rod)

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


def written(folder, text=None, **kwargs):
    """Write a hand as URDF, of a text or as `urdf` makes it, and return the path."""
    path = folder / "claw.urdf"
    path.write_text(text or urdf(**kwargs))
    return path


def hand_of(folder, path, *told):
    """Return what `make` notes of a hand, and its file."""
    notes = make_robot(path, None, folder / "claw.yaml", *told)
    return notes, yaml.safe_load((folder / "claw_hand.yaml").read_text())


def built(entry):
    """Return the compiled model of what a hand's file says."""
    return compiled(make_hand({**entry, "open": np.clip(0.0, entry["lower"], entry["upper"]).tolist()}))


def test_a_urdf_keeps_the_torques_and_velocities_it_states(tmp_path):
    notes, hand = hand_of(tmp_path, written(tmp_path))
    assert not any("inertia" in note for note in notes)
    tips = {f["name"]: f["bodies"][-1] for f in hand["fingers"]}
    assert (tips[hand["grasp"][0]], hand["palm"]) == ("thumb_far", "plate")
    assert hand["velocity"] == [4.0] * 9
    assert hand["torque"] == [1.5] * 9
    assert make_cell(str(tmp_path / "claw.yaml")).robot.dof == 7 + 9


def test_mimics_become_couplings_and_the_open_posture_obeys_them(tmp_path):
    notes, hand = hand_of(tmp_path, written(tmp_path, mimic=True))
    found = {own["joint"]: (own["follows"], own["ratio"], own["offset"]) for own in hand["couplings"]}
    assert found == {f"{name}_curl": (f"{name}_flex", 0.8, 0.1) for name in FINGERS}
    names = [joint for finger in hand["fingers"] for joint in finger["joints"]]
    at = dict(zip(names, hand["open"], strict=True))
    assert all(abs(at[f"{n}_curl"] - 0.8 * at[f"{n}_flex"] - 0.1) < 1e-3 for n in FINGERS)
    assert any("couplings" in note for note in notes)
    whole = make_cell(str(tmp_path / "claw.yaml")).robot.hand
    idle = whole.finger(whole.grasp[-1])
    fingers = [replace(f, aside=(0.0,) * len(f.joints)) if f is idle else f for f in whole.fingers]
    pinch = replace(whole, grasp=whole.grasp[:2], fingers=tuple(fingers))
    at = dict(zip(pinch.joints.names, put_aside(pinch, compiled(pinch), hand["open"]), strict=True))
    assert all(abs(at[f"{n}_curl"] - 0.8 * at[f"{n}_flex"] - 0.1) < 1e-3 for n in FINGERS)


@pytest.mark.parametrize("tight", ['limited="true" range="-0.001 0.001"', 'stiffness="3" springlength="0"'])
def test_a_fixed_tendon_without_slack_or_a_spring_couples_its_two_joints(tight, tmp_path):
    tendon = (
        f'<tendon><fixed {tight}><joint joint="fore_curl" coef="0.008"/>'
        '<joint joint="fore_flex" coef="-0.007"/></fixed></tendon><actuator><motor joint="fore_flex"/></actuator>'
        '<equality><joint joint1="mid_curl" joint2="mid_flex" active="false"/></equality></mujoco>'
    )
    path = mjcf(tmp_path, lambda text: text.replace("</mujoco>", tendon))
    (own,) = HandMaker(path).couplings  # and none of the equality, which is switched off
    assert (own.joint, own.follows, own.ratio) == ("fore_curl", "fore_flex", pytest.approx(7 / 8))


def test_a_chain_of_mimics_is_led_by_its_first_joint(tmp_path):
    led = r'\1<mimic joint="fore_flex" multiplier="0.5"/>'
    text = re.sub(r'(<joint name="mid_flex".*?)(?=</joint>)', led, urdf(mimic=True))
    own = {own.joint: own for own in HandMaker(written(tmp_path, text)).couplings}["mid_curl"]
    assert (own.follows, own.ratio, own.offset) == ("fore_flex", pytest.approx(0.4), pytest.approx(0.1))


@pytest.fixture
def meshed(tmp_path):
    """Return what writes the claw with rods of a mesh, kept in `claw_description/meshes` of `tmp_path`."""
    folder = tmp_path / "claw_description"
    for name in ("meshes", "urdf"):
        (folder / name).mkdir(parents=True)
    trimesh.creation.box((0.02, 0.02, 0.05)).export(folder / "meshes" / "rod.stl")

    def write(name):
        path = folder / "urdf" / "claw.urdf"
        path.write_text(urdf(shape=f'<mesh filename="{name}"/>'))
        return path

    return write


@pytest.mark.parametrize(
    "name",
    [
        "package://claw_description/meshes/rod.stl", "../meshes/rod.stl", "meshes/rod.stl",
        "package://other_name/meshes/rod.stl", "model://claw_description/meshes/rod.stl",
        "C:\\ws\\claw_description\\meshes\\rod.stl",
        "package://claw_description/Meshes/ROD.STL",
    ],
)  # fmt: skip
def test_meshes_are_found_whatever_comes_first_in_their_names(name, meshed):
    assert read_source(meshed(name)).model.nmesh > 0


def test_a_mesh_that_is_not_there_is_named(meshed):
    with refused(r"mesh 'package://other/none.stl' of link 'fore_base' is not found"):
        read_source(meshed("package://other/none.stl"))


@pytest.mark.parametrize("kind", ["ply", "glb", "dae", "stl_ascii"])
def test_meshes_of_other_kinds_are_converted_and_noted(kind, meshed, tmp_path):
    folder, box = tmp_path / "claw_description" / "meshes", trimesh.creation.box((0.02, 0.02, 0.05))
    if kind == "dae":
        pytest.importorskip("collada")
        from trimesh.exchange.dae import export_collada

        text = export_collada(box.apply_scale(1000.0)).decode()  # mm
        data = (
            re.sub("<unit[^>]*/>", "", text)
            .replace("<asset>", '<asset><unit name="mm" meter="0.001"/>')
            .encode()
        )
    else:
        data = box.export(file_type=kind)
    suffix = kind.removesuffix("_ascii")
    (folder / f"other.{suffix}").write_bytes(data.encode() if isinstance(data, str) else data)
    source = read_source(meshed(f"package://claw_description/meshes/other.{suffix}"))
    assert any(f"converted: .{suffix}" in note for note in source.notes)
    rod = source.model.body("fore_near").geomadr[0]
    assert_allclose(np.sort(source.model.geom_aabb[rod, 3:]), [0.01, 0.01, 0.025], atol=1e-5)


@pytest.mark.parametrize("links", [r"\w+", r"\w+_far"])
def test_what_is_seen_collides_where_nothing_of_a_description_or_its_last_links_does(links, tmp_path):
    text = re.sub(rf'(<link name="{links}">.*?<)collision(.*?</)collision', r"\1visual\2visual", urdf())
    assert any("visual shapes" in note for note in HandMaker(written(tmp_path, text)).notes)


@pytest.mark.parametrize(
    ("write", "pattern", "put", "said", "joints"),
    [
        *((mjcf, *row) for row in table("mended")),
        *((lambda folder, edit: written(folder, edit(urdf())), *row) for row in table("mended_urdf")),
    ],
)
def test_what_makers_write_otherwise_is_mended_or_refused_in_a_line(
    write, pattern, put, said, joints, tmp_path
):
    path = write(tmp_path, lambda text: re.sub(pattern, put, text, count=0 if joints < 0 else 1))
    if joints <= 0:
        with refused(said):
            HandMaker(path).entry()
        return
    maker = HandMaker(path)
    assert built(maker.entry()).njnt == joints
    assert parts_of(path) == (True, False)
    assert any(said in note for note in maker.notes)


AROUND = table("fingers_around")


@pytest.mark.parametrize(
    ("pattern", "by"),
    [
        ("", ""),
        # A joint that bends to both sides does not say which is the pad's.
        (r'(name="\w+_curl".*?)0 1 0(.*?)lower="0"', r'\g<1>0 -1 0\g<2>lower="-1.6"'),
        # Drawn closed, fingers open from 0.
        (r'rpy="0 0 0"(.*?)lower="[-.\d]+" upper="1.."', r'rpy="0 0.35 0"\g<1>lower="-0.5" upper="0"'),
    ],
)
def test_a_claw_approaches_along_its_fingers_whichever_way_they_could_bend(pattern, by, tmp_path):
    maker = HandMaker(written(tmp_path, re.sub(pattern, by, urdf(fingers=AROUND))))
    assert_allclose(maker.frame[:3, 0], [0.0, 0.0, 1.0], atol=1e-6)
    for k in range(3):
        tip = maker.tip(k)
        assert tip[:3, 0] @ -tip[:3, 3] > 0.0  # pads face the axis


def test_fingers_that_are_drawn_bent_are_stretched_to_see_the_palm(tmp_path):
    text = urdf().replace('"0 0 0.055" rpy="0 0 0"', '"0 0 0.055" rpy="0 0.7 0"')
    bent = text.replace('lower="0" upper="1.6"', 'lower="-0.7" upper="1.2"')
    frames = [HandMaker(written(tmp_path, each)).frame for each in (None, bent)]
    assert_allclose(*frames, atol=1e-6)


LEFT = {
    name: (f"{xyz.split()[0]} {-float(xyz.split()[1])} {xyz.split()[2]}", rpy.replace("-", ""), *rest)
    for name, (xyz, rpy, *rest) in FINGERS.items()
}


@pytest.mark.slow
def test_left_and_right_hands_grasp_mirrored_objects_in_mirrored_ways(tmp_path):
    """From mirrored starts: what is drawn before them is not mirrored."""
    cells = []
    for side, fingers in (("right", FINGERS), ("left", LEFT)):
        make_robot(written(tmp_path, fingers=fingers), None, tmp_path / f"{side}.yaml")
        cells.append(make_cell(str(tmp_path / f"{side}.yaml")))
    robot, settings = cells[0].robot, PlannerSettings()
    turned = [
        name[-1] in "1357" if name.startswith("panda") else name.endswith("spread") for name in robot.joints
    ]
    sign, mirror = np.where(turned, -1.0, 1.0), np.diag([1.0, -1.0, 1.0])
    for q in robot.drawn(20):
        tips = [fingertips(at, robot_tree(cell)) for at, cell in zip((q, sign * q), cells, strict=True)]
        assert_allclose(tips[0] @ mirror, tips[1], atol=1e-12)
    problems = [
        GraspProblem(lying((0.05, 0.08, 0.12), at=(0.5, y)), cell, settings)
        for y, cell in zip((0.1, -0.1), cells, strict=True)
    ]
    drawn = SurfaceProposals().propose(problems[0].target, settings, np.random.default_rng(0))
    starts = list(atlas_postures(drawn, problems[0]))[:12]
    assert len(starts) == 12
    for start in starts:
        ours, theirs = (
            solve(at, problem).q for at, problem in zip((start.q, sign * start.q), problems, strict=True)
        )
        assert_allclose(sign * ours, theirs, atol=1e-6)


def test_first_links_of_fingers_may_be_nearer_when_a_hand_opens(monkeypatch):
    problem = GraspProblem(lying((0.05, 0.08, 0.12)), make_cell(), PlannerSettings())
    bodies, fingers = problem.cell.robot.bodies, problem.cell.robot.grasping[1:]
    labels = np.array([[SELF, *(bodies.index(finger.bodies[k]) for finger in fingers)] for k in (0, 2)])
    near = {False: (np.full(2, 0.002), labels), True: ([], labels[:0])}  # at home nothing is
    monkeypatch.setattr(certificate_builder, "clearances", lambda *args: near[args[-1]])
    assert_allclose(certificate_builder.too_near(problem.cell.robot.home, problem, 0.004), labels[1:])


def test_where_few_postures_press_more_are_drawn_around_them(tmp_path, monkeypatch):
    hand_of(tmp_path, written(tmp_path))
    monkeypatch.setattr(atlas, "SAMPLES", 500)
    assert len(atlas.hand_atlas(make_cell(str(tmp_path / "claw.yaml"))).joints) > 1000


def two_hands():
    """Return two claws on one stand, as URDF text."""
    stand = LINK.format(
        name="stand", mass=5, ixx="0.1", tag="collision", z=0, shape='<box size="0.1 0.1 0.1"/>'
    )
    parts = [stand.replace("1e-5", "0.1")]
    for side, y in (("l", 0.15), ("r", -0.15)):
        inner = re.sub(r'(name|link|joint)="(\w+)"', rf'\1="{side}_\2"', urdf().partition(">")[2])
        parts.append(inner.partition(">")[2].removesuffix("</robot>"))
        parts.append(
            f'<joint name="{side}" type="fixed"><parent link="stand"/><child link="{side}_plate"/>'
            f'<origin xyz="0 {y} 0.2"/></joint>'
        )
    return f'<robot name="two">{"".join(parts)}</robot>'


def test_of_two_hands_in_one_file_the_palm_says_which_is_meant(tmp_path):
    path = written(tmp_path, two_hands())
    with refused("several hands, on 'l_plate', 'r_plate': --palm BODY takes one"):
        HandMaker(path)
    hand = built(HandMaker(path, NamedParts(palm="r_plate")).entry())
    assert {hand.joint(j).name[:2] for j in range(hand.njnt)} == {"r_"}
    assert hand.njnt == 9


def test_a_palm_that_is_the_world_becomes_a_body(tmp_path):
    def edit(text):
        text = re.sub(r'<body name="plate">\s*<inertial[^>]*>', "", text, count=1)
        return text[::-1].replace(">ydob/<", "", 1)[::-1]

    maker = HandMaker(mjcf(tmp_path, edit))
    assert maker.entry()["palm"] == "base"
    assert any("'base'" in note for note in maker.notes)
    named = lambda text: edit(text).replace('"fore_base"', '"base"')  # noqa: E731
    assert HandMaker(mjcf(tmp_path, named)).entry()["palm"] == "base_base"


@pytest.mark.parametrize("palm", ["plate", "l5_palm"])
def test_an_arm_and_a_hand_in_one_file_are_parted_where_fingers_branch(palm, tmp_path):
    """The palm is a link of its own, or what the fingers hang on is the arm's last link."""
    names, ball = ["stand", *(f"l{k}" for k in range(6))], '<sphere radius="0.035"/>'
    links = [LINK.format(name=n, mass=1, ixx="1e-2", tag="collision", z=0.0, shape=ball) for n in names]
    arm = [link.replace("1e-5", "1e-2") for link in links] + table("tool_and_palm")
    for k, (xyz, axis) in enumerate(table("six_joints")):
        arm.append(JOINT.format(name=f"a{k}", parent=names[k], child=names[k + 1], xyz=xyz, rpy="0 0 0", axis=axis,
                                low=-3, high=3, rate=2.0, mimic=""))  # fmt: skip
    text = urdf(prefix=arm)
    if palm != "plate":
        text = re.sub('<joint name="flange".*?</joint>|<link name="plate">.*?</link>', "", text)
        text = text.replace('<parent link="plate"/>', '<parent link="l5"/>')
    path = written(tmp_path, text)
    make_robot(path, path, tmp_path / "both.yaml")
    cell = make_cell(str(tmp_path / "both.yaml"))
    robot, maker = cell.robot, HandMaker(path)
    tips = fingertips(np.clip(0.0, robot.lower, robot.upper), robot_tree(cell)) - cell.base
    assert_allclose(
        np.sort(tips, axis=0), np.sort([maker.tip(k)[:3, 3] for k in range(3)], axis=0), atol=1e-5
    )
    assert robot.arm.joints.names == tuple(f"a{k}" for k in range(6))
    assert_allclose(robot.arm.frame.position, [0.0, 0.05 * (palm == "plate"), 0.0], atol=1e-9)
    # Its own sphere, as it collides and as it is seen.
    assert described(robot.arm).compile().body("l5").geomnum[0] == 2
    assert robot.hand.palm == palm
