"""Robots of somebody else's MJCF: rebuilt as they are, made into files, tested; what is wrong is said in a line."""

import json
import re
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest
import yaml
from PIL import Image
from robots import CELL

from dexgrasp.cli.commands import run_command
from dexgrasp.geometry.exact import closest_on_mesh
from dexgrasp.grasp.file import record_of
from dexgrasp.kinematics.cover import hull_cells
from dexgrasp.kinematics.pairs import meeting_pairs
from dexgrasp.kinematics.palm_ik import palm_frame, reach_palm
from dexgrasp.kinematics.robot_check import check_robot
from dexgrasp.kinematics.tree import robot_tree
from dexgrasp.planning.look import look_at
from dexgrasp.planning.sources import make_source
from dexgrasp.registry import make_agent
from dexgrasp.verify.verify import verify
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.robot.hulls import cut, hull_of
from dexgrasp_env.robot.make import make_robot
from dexgrasp_env.robot.model import compiled_robot
from dexgrasp_env.robot.robot_file import read_robot

ALLEGRO, PANDA = asset_path("robot", "allegro.xml"), asset_path("robot", "panda.xml")


def foreign_hand(folder: Path) -> Path:
    """Our hand as somebody else would describe it: turned, joints and motors renamed, no sites at its tips."""
    spec = mujoco.MjSpec.from_file(str(ALLEGRO))
    spec.meshdir = str(asset_path("robot", "shells"))
    spec.body("palm").quat = [0.5, 0.5, -0.5, 0.5]
    for joint in spec.joints:
        joint.name = f"rh_{joint.name}"
    for actuator in spec.actuators:
        actuator.name, actuator.target = f"motor_{actuator.name}", f"rh_{actuator.target}"
    for finger in ("index", "middle", "ring", "thumb"):
        spec.delete(spec.site(f"{finger}_tip"))
    path = folder / "theirs.xml"
    path.write_text(spec.to_xml())
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    out = folder / "theirs.yaml"
    assumed = make_robot(foreign_hand(folder), None, out)
    assert any("velocity" in line for line in assumed)
    return out


def test_a_hand_made_of_mjcf_is_where_ours_is(made):
    cell = make_cell(made)
    theirs, ours = compiled_robot(cell), compiled_robot(CELL)
    assert [theirs.joint(j).name for j in range(theirs.njnt)] == list(cell.robot.joints)
    rng, hand, mine = np.random.default_rng(0), cell.robot.hand, CELL.robot.hand
    assert hand.tip_radius == pytest.approx(0.014, abs=2e-4)
    masses = [
        model.body_subtreemass[model.body(palm).id]
        for model, palm in ((theirs, hand.palm), (ours, mine.palm))
    ]
    assert masses[0] == pytest.approx(masses[1], rel=1e-6)
    for _ in range(5):
        q = rng.uniform(CELL.robot.lower, CELL.robot.upper)
        places = []
        for model, part in ((theirs, hand), (ours, mine)):
            data = mujoco.MjData(model)
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            palm = data.site(part.palm)
            R = palm.xmat.reshape(3, 3)
            places.append([
                np.r_[(data.site(f.tip).xpos - palm.xpos) @ R, (R.T @ data.site(f.tip).xmat.reshape(3, 3)).ravel()]
                for f in part.fingers
            ])  # fmt: skip
        away = np.array(places[0]) - places[1]
        assert np.ptp(away[:, :3], axis=0).max() < 5e-4  # the palm's origin lies 1 mm elsewhere
        assert np.abs(away[:, :3]).max() < 2e-3
        assert np.abs(away[:, 3:]).max() < 1e-5


def test_what_is_made_passes_its_check_and_grasps(made):
    cell = make_cell(made)
    assert [finding for finding in check_robot(cell) if finding.level == "error"] == []
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", robot=str(made))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    agent = make_agent("bilevel")
    look = look_at("sugar_box", agent, seed=3, robot=str(made))
    plan = agent.plan(look.observation, look.info)
    content = plan.contents(look.subject.identity, "bilevel", look.subject.pose)[0]
    assert content["thresholds"]["tip_radius"] == cell.robot.hand.tip_radius
    assert [check.name for check in verify(record_of(content, cell=cell)) if not check.holds] == []
    content["thresholds"]["tip_radius"] = 0.02
    assert "thresholds looser than ours" in [
        c.name for c in verify(record_of(content, cell=cell)) if not c.holds
    ]


def test_an_arm_made_of_mjcf_stands_as_ours(tmp_path, made):
    make_robot(foreign_hand(tmp_path), PANDA, tmp_path / "arm.yaml")
    cell = make_cell(tmp_path / "arm.yaml")
    theirs, ours = compiled_robot(cell), compiled_robot(CELL)
    q = np.random.default_rng(0).uniform(CELL.robot.lower, CELL.robot.upper)
    last = []
    for model in (theirs, ours):
        data = mujoco.MjData(model)
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        last.append(np.r_[data.body("panda_link7").xpos, data.body("panda_link7").xmat])
    np.testing.assert_allclose(last[0], last[1], atol=1e-6)
    assert [finding for finding in check_robot(cell) if finding.level == "error"] == []


_SIX = (("0 0 0.16", "0 0 1"), ("0 0.13 0", "0 1 0"), ("0 -0.12 0.42", "0 1 0"), ("0 0 0.39", "0 1 0"),
        ("0 0.12 0", "0 0 1"), ("0 0 0.1", "0 1 0"))  # fmt: skip
"""Where each joint of an arm like a UR5 sits in the body before, and its axis."""


def six_joint_arm(folder: Path) -> Path:
    """An arm of six joints, of capsules, that states neither torques nor rates."""
    links = "".join(
        f'<body name="link{k}" pos="{pos}"><joint name="j{k}" axis="{axis}" range="-3.1 3.1"/>'
        f'<geom type="capsule" fromto="0 0 0 {following}" size="0.04" mass="2"/>'
        for k, ((pos, axis), following) in enumerate(
            zip(_SIX, [p for p, _ in _SIX[1:]] + ["0 0.03 0"], strict=True)
        )
    )
    flange = '<site name="flange" pos="0 0.09 0" quat="-0.7071068 0.7071068 0 0"/>'
    path = folder / "six.xml"
    path.write_text(
        f'<mujoco><compiler angle="radian"/><worldbody><body name="stand"><geom size="0.05"/>'
        f'{links}{flange}{"</body>" * 7}</worldbody></mujoco>'
    )  # fmt: skip
    return path


def test_an_arm_of_six_joints_bears_our_hand(tmp_path, capsys):
    out = tmp_path / "six.yaml"
    assert run_command(["robot", "make", "--arm", str(six_joint_arm(tmp_path)), "--out", str(out)]) == 0
    assert "arm torque: none in six.xml" in capsys.readouterr().out
    cell = make_cell(out)
    assert cell.robot.dof == 22
    assert cell.robot.hand.joints.names == CELL.robot.hand.joints.names
    assert [finding for finding in check_robot(cell) if finding.level == "error"] == []
    assert run_command(["list", "envs", "--robot", str(out), "--json"]) == 0
    own = json.loads(capsys.readouterr().out)["robot"]
    assert own["joints"] == list(cell.robot.joints)
    for mode, size in own["control_mode"].items():
        env = gym.make("DexGrasp/Lift-v2", objects="pear", robot=str(out), control_mode=mode)
        assert env.action_space.shape == (size,)
        spaces = {key: space.shape for key, space in env.observation_space.items()}
        assert spaces == {key: (n,) for key, n in own["observations"].items()}
    tree = robot_tree(cell)
    q, turned = tree.home.copy(), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    assert reach_palm(q, turned, np.array([0.45, 0.1, 0.25]), tree)
    np.testing.assert_allclose(palm_frame(q, tree)[1], [0.45, 0.1, 0.25], atol=2e-3)


def test_starts_of_inverse_kinematics_are_data(tmp_path):
    make_robot(None, six_joint_arm(tmp_path), tmp_path / "six.yaml")
    arm = yaml.safe_load((tmp_path / "six_arm.yaml").read_text())
    assert robot_tree(make_cell(read_robot(tmp_path / "six.yaml"))).starts.shape == (5, 6)
    starts = [arm["home"], [0.1] * 6]
    (tmp_path / "six_arm.yaml").write_text(yaml.safe_dump(arm | {"starts": starts, "plinth": 2}))
    tree = robot_tree(make_cell(read_robot(tmp_path / "six.yaml")))
    np.testing.assert_array_equal(tree.starts, starts)
    assert tree.base == 2
    (tmp_path / "six_arm.yaml").write_text(yaml.safe_dump(arm | {"starts": [[0.0]]}))
    with pytest.raises(InputError, match="a posture of starts has 1 numbers: valid are 6"):
        read_robot(tmp_path / "six.yaml")


def test_pairs_found_by_sampling_hold_ours():
    found = {frozenset(pair) for pair in meeting_pairs(CELL.robot, compiled_robot(CELL))}
    ours = {frozenset(pair) for pair in CELL.robot.hand.self_pairs}
    assert len(found & ours) > 0.7 * len(found)


def test_spheres_cover_a_hull_from_outside():
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(40, 3)) * [0.02, 0.012, 0.03]
    centres, radii = hull_cells(corners, 0.006)
    weights = rng.dirichlet(np.full(40, 0.1), 2000)
    apart = np.linalg.norm((weights @ corners)[:, None] - centres, axis=2) - radii
    import trimesh

    hull = trimesh.convex.convex_hull(corners)
    depth = closest_on_mesh(hull, weights @ corners).distances
    assert (apart.min(1) < 1e-9)[np.abs(depth) < 0.001].all()
    out = centres + radii[:, None] * (centres / np.linalg.norm(centres, axis=1)[:, None])
    assert closest_on_mesh(hull, out).distances.max() < 0.008


def test_a_hull_is_cut_in_two():
    above, below = cut(np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T, 0.5)
    assert (above[:, 2].min(), above[:, 2].max()) == (0.5, 1.0)
    assert (below[:, 2].min(), below[:, 2].max()) == (-1.0, 0.5)
    assert len(hull_of(above)[0]) == 8


def test_weights_are_of_one_hand(made):
    with pytest.raises(InputError, match="weights are of the hand 'allegro'"):
        make_source("cvae", make_cell(made).robot)
    assert type(make_source("auto", make_cell(made).robot)).__name__ == "SurfaceProposals"


def test_the_commands(tmp_path, capsys):
    assert run_command(["robot", "list", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["robots"][0]["name"] == "panda_allegro"
    assert run_command(["robot", "make", "--hand", str(ALLEGRO), "--out", str(tmp_path / "a.yaml")]) == 0
    assert "assumed" in capsys.readouterr().out
    hand = yaml.safe_load((tmp_path / "a_hand.yaml").read_text())
    hand["fingers"][-1]["frame"]["position"][2] += 0.01
    (tmp_path / "a_hand.yaml").write_text(yaml.safe_dump(hand))
    assert run_command(["robot", "check", str(tmp_path / "a.yaml")]) == 1
    assert "the end of thumb_tip is" in capsys.readouterr().out


def test_the_check_draws_the_hand(made, tmp_path, capsys):
    assert run_command(["robot", "check", str(made), "--picture", str(tmp_path / "hand.png"), "--json"]) == 0
    assert not any(
        "no grasp of" in finding["problem"] for finding in json.loads(capsys.readouterr().out)["findings"]
    )
    width, height = Image.open(tmp_path / "hand.png").size
    assert width > 4 * height  # five side by side
    assert run_command(["robot", "check", "nowhere.yaml", "--picture", str(tmp_path / "none.png")]) == 2
    assert not (tmp_path / "none.png").exists()


def test_a_name_of_no_robot_is_said(capsys):
    assert run_command(["robot", "check", "sideways"]) == 2
    assert "panda_allegro" in capsys.readouterr().err


_PHANTOM = '<position name="phantom" joint="index_1" kp="10"/></actuator>'


_BACKWARDS = [0.5**0.5, 0.0, 0.5**0.5, 0.0]


def _shifted(hand: dict, finger: int, frame: dict) -> dict:
    fingers = [dict(entry) for entry in hand["fingers"]]
    fingers[finger]["frame"] = fingers[finger]["frame"] | frame
    return {"fingers": fingers}


@pytest.mark.parametrize(
    ("change", "problem", "mend"),
    [
        (lambda h: {"open": h["lower"]}, "in front of the palm", "bend `open` further"),
        (lambda h: {"open": [-0.4, 1.5, 0.8, 0.8, 0.4, 1.5, 0.8, 0.8, -0.4, 1.5, 0.8, 0.8, *h["open"][12:]]},
         "touch with the hand open", "change `open`"),
        (lambda h: {"stiffness": 0.01}, "follows its servo by", "raise its stiffness"),
        (lambda h: _shifted(h, 0, {"position": [0.0, 0.0, 0.1]}), "mm from its centre", "shift the tip's frame"),
        (lambda h: _shifted(h, 3, {"quat_wxyz": [0.0, 0.0, 0.0, 1.0]}), "looks away|face each other", "tip.s frame"),
        (lambda h: {"torque": 0.05}, "can press with", "torque of its joints"),
        (lambda h: {"upper": [*h["upper"][:12], *(q + 0.01 for q in h["lower"][12:])],
                    "open": [*h["open"][:12], *h["lower"][12:]]}, "face each other", "wider ranges"),
        (lambda h: {"mounts": {"palm_normal": {"position": [0.0, 0.0, 0.3], "quat_wxyz": _BACKWARDS}}},
         "palm poses over the table are reached", "`home` or `starts`"),
    ],
)  # fmt: skip
def test_the_check_finds_a_fault_and_says_its_mend(change, problem, mend, made, tmp_path):
    hand = yaml.safe_load(made.with_name("theirs_hand.yaml").read_text())
    (tmp_path / "hand.yaml").write_text(yaml.safe_dump(hand | change(hand)))
    robot = yaml.safe_load(made.read_text()) | {"hand": "hand.yaml"}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
    found = [
        finding for finding in check_robot(make_cell(tmp_path / "robot.yaml")) if finding.level != "info"
    ]
    assert any(re.search(problem, f.problem) and re.search(mend, f.remedy) for f in found), found


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda text: text.replace("</actuator>", _PHANTOM), "actuators are"),
        (lambda text: re.sub(r'<[a-z]+ [^>]*name="index_0" [^>]*joint="index_0"[^>]*/>', "", text), "no actuator"),
        (lambda text: text.replace("</contact>", '<exclude body1="thumb_distal" body2="index_distal"/></contact>'),
         "get .* mm into each other"),
        (lambda text: text.replace('body name="index_', 'body name="x_'), "has no body 'index_base'"),
    ],
)  # fmt: skip
def test_the_check_finds_a_fault_of_a_description(change, problem, tmp_path, capsys):
    text = ALLEGRO.read_text().replace('meshdir="', f'meshdir="{ALLEGRO.parent}/')
    assert change(text) != text
    (tmp_path / "hand.xml").write_text(change(text))
    (tmp_path / "hand.yaml").write_text(yaml.safe_dump(HAND | {"mjcf": "hand.xml"}))
    robot = {"schema": 1, "kind": "robot", "name": "mine", "arm": "panda.yaml", "hand": "hand.yaml"}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot | {"mount": "palm_normal"}))
    run_command(["robot", "check", str(tmp_path / "robot.yaml")])
    said = capsys.readouterr()
    assert re.search(problem, said.out + said.err)
    assert "Traceback" not in said.err


HAND = yaml.safe_load(asset_path("robot", "allegro.yaml").read_text())
FRAME = {"position": [0.0, 0.0, 0.0]}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": 2}, "schema: 1"),
        ({"mjcf": "nowhere.xml"}, "nowhere.xml does not exist"),
        ({"palm": ""}, "valid is a word"),
        ({"fingers": HAND["fingers"][:1]}, "two fingers"),
        ({"open": [0.0] * 15}, "valid are 16"),
        ({"open": [9.0] * 16}, "valid ranges hold home"),
        ({"grasp": ["thumb", "pinky"]}, "finger of a grasp 'pinky'"),
        ({"torque": [0.7] * 3}, "valid are 16"),
        ({"tip_radius": -1.0}, "> 0"),
        ({"frame": {"position": [0.0, 0.0]}}, "list of 3"),
        ({"frame": {**FRAME, "quat_wxyz": [1.0, 1.0, 0.0, 0.0]}}, "unit quaternion"),
        ({"frame": FRAME}, "a finger has no frame"),
        ({"palm": "hand"}, "name palm: no body"),
        ({"self_pairs": [["palm", "nose"]]}, "no body of the hand"),
        ({"mounts": {}}, "unknown mount"),
    ],
)  # fmt: skip
def test_a_broken_robot_file_is_said_in_one_line(change, words, tmp_path, capsys):
    (tmp_path / "hand.yaml").write_text(yaml.safe_dump(HAND | change))
    robot = {"schema": 1, "kind": "robot", "name": "mine", "arm": "panda.yaml", "hand": "hand.yaml"}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot | {"mount": "palm_normal"}))
    assert run_command(["robot", "check", str(tmp_path / "robot.yaml")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(words, line), line


_ARM = yaml.safe_load(asset_path("robot", "panda.yaml").read_text())


@pytest.mark.parametrize(
    ("arm", "robot", "words"),
    [
        ({"bodies": _ARM["bodies"][:-1]}, {}, "bodies are 7: valid are a base and one for each of 7 joints"),
        ({"joints": []}, {}, "joints"),
        ({"joints": ["j"] * 7}, {}, "names, each once"),
        ({"starts": [[0.0, 1.0]]}, {}, "starts has 2 numbers: valid are 7"),
        ({"plinth": -1}, {}, "plinth"),
        ({"shaken": [0, 9]}, {}, "two numbers of joints"),
        ({"reach": 0}, {}, "reach"),
        ({"home": [0.0] * 7}, {}, "valid ranges hold home"),
        ({"frame": {"position": [0.0, 0.0, 0.1], "quat_wxyz": [0.0, 1.0, 0.0, 0.0]}}, {}, "axis of the last joint"),
        ({"mjcf": "."}, {}, "it is no file"),
        ({"velocity": "fast"}, {}, "velocity"),
        ({}, {"mount": "sideways"}, "unknown mount 'sideways'"),
        ({}, {"hand": "gone.yaml"}, "gone.yaml does not exist"),
        ({}, {"arm": ["arm.yaml"]}, "arm"),
        ({}, {"legs": 2}, "legs"),
        ({}, {"arm": None}, "arm"),
    ],
)  # fmt: skip
def test_a_broken_arm_or_robot_is_said_in_one_line(arm, robot, words, tmp_path, capsys):
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(_ARM | arm))
    whole = {"schema": 1, "kind": "robot", "name": "mine", "arm": "arm.yaml", "hand": "allegro.yaml"}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(whole | {"mount": "palm_normal"} | robot))
    assert run_command(["robot", "check", str(tmp_path / "robot.yaml")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(words, line), line


_LINK = '<geom type="capsule" fromto="0 0 0 0 0 0.05" size="0.01"/>'
_FINGER = '<body name="{n}" pos="0 {y} 0"><joint name="{n}" range="-1 1"/>' + _LINK + "</body>"
_THREE = "".join(_FINGER.format(n=f"f{k}", y=0.03 * k) for k in range(3))
_COUPLED = '<equality><joint joint1="f0" joint2="f1"/></equality>'


def _hand(inside: str, after: str = "") -> str:
    return f'<mujoco><worldbody><body name="p"><geom size="0.01"/>{inside}</body></worldbody>{after}</mujoco>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<mujoco><worldbody>", "MuJoCo cannot read"),
        ('<mujoco><include file="gone.xml"/></mujoco>', "MuJoCo cannot read"),
        ('<mujoco><asset><mesh name="m" file="gone.stl"/></asset></mujoco>', "MuJoCo cannot read"),
        ('<mujoco><asset><mesh name="m" file="/gone/gone.stl"/></asset></mujoco>', "MuJoCo cannot read"),
        ('<mujoco><include file="hand.xml"/></mujoco>', "MuJoCo cannot read"),
        ("<mujoco/>", "no joints"),
        ("<mujoco>" + "<!-- much -->" * 800_000, "MuJoCo cannot read"),
        ("\0" * 100, "MuJoCo cannot read"),
        (
            _hand(_THREE, '<equality><connect body1="f0" body2="f2" anchor="0 0 0.05"/></equality>'),
            "couples joints",
        ),
        (_hand("<freejoint/>" + _THREE), "hinges"),
        (_hand('<joint name="w"/>' + _THREE), "before its palm"),
        (_hand(_THREE, _COUPLED), "couples joints"),
        (_hand(_THREE.replace(_LINK, '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>')), "collides"),
        (_hand(_FINGER.format(n="a", y=0)), "branches"),
        (_hand(_THREE.replace('name="f1"', "")), "no name"),
    ],
)
def test_a_broken_mjcf_is_said_in_one_line(text, words, tmp_path, capsys):
    (tmp_path / "hand.xml").write_text(text)
    assert (
        run_command(
            ["robot", "make", "--hand", str(tmp_path / "hand.xml"), "--out", str(tmp_path / "a.yaml")]
        )
        == 2
    )
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(words, line), line
    assert not (tmp_path / "a.yaml").exists()
