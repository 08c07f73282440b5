"""What is no hand and no arm ends in one line, within bounded time and memory."""

import re

import pytest
from processes import typed
from refusals import refused
from tables import mistakes

from dexgrasp_env.robot.make import make_robot, parts_of
from dexgrasp_env.robot.source import read_source

LEG = (
    '<body name="{n}{k}" pos="{pos}"><joint name="{n}{k}" axis="0 1 0" range="-1 1"/>'
    '<geom type="capsule" size="0.04" fromto="0 0 0 0 0 -0.35" mass="1"/>'
)


def limbs(count):
    """Return an MJCF of a trunk with limbs of two links, 0.7 m long."""
    legs = "".join(
        LEG.format(n=n, k=1, pos=f"{0.2 * n} 0 0") + LEG.format(n=n, k=2, pos="0 0 -0.35") + "</body></body>"
        for n in range(count)
    )
    return (
        '<mujoco><compiler angle="radian"/><worldbody><body name="trunk"><freejoint/>'
        f'<geom type="box" size="0.3 0.1 0.1" mass="10"/>{legs}</body></worldbody></mujoco>'
    )


CHAIR = (
    '<mujoco><worldbody><body name="chair"><geom type="box" size="0.2 0.2 0.2"/></body></worldbody></mujoco>'
)
BOMB = '<!DOCTYPE a [<!ENTITY b "x"><!ENTITY c "&b;&b;">]><mujoco>&c;</mujoco>'
MANY = "<mujoco><worldbody>" + '<geom size="1"/>' * 100_001 + "</worldbody></mujoco>"
DEEP = "<mujoco><worldbody>" + "<body>" * 400 + "</body>" * 400 + "</worldbody></mujoco>"
COPY = '<replicate count="300" offset="1 0 0">'
COPIES = f'<mujoco><worldbody>{COPY * 3}<geom size="1"/>{"</replicate>" * 3}</worldbody></mujoco>'
FIELD = '<mujoco><asset><hfield name="a" nrow="{side}" ncol="{side}" size="1 1 1 1"/></asset></mujoco>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (CHAIR, "has no joints"),
        (limbs(4), "reaches 0.98 m: no hand does"),
        (BOMB, "defines entities"),
        (BOMB.encode("utf-16"), "defines entities"),
        (MANY, "over 100000 elements"),
        (DEEP, "150 in each other"),
        (COPIES, "over 100000 elements"),
        (FIELD.format(side=60_000), "over 100000 elements"),
        (limbs(3).replace("-0.35", "nan"), "no finite number|cannot read"),
        *mistakes("nonsense"),
        *mistakes("broken_mjcf"),
    ],
)
def test_it_is_refused_in_a_line(text, words, tmp_path, capsys):
    path = tmp_path / "bad.xml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with refused(words):
        make_robot(path, None, tmp_path / "out.yaml")
    assert typed(f"robot make --hand {path} --out {tmp_path / 'out.yaml'}") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(words, line)
    assert [*tmp_path.iterdir()] == [path]


def test_includes_that_double_are_bounded(tmp_path):
    """Each of 30 files includes the next twice: a thousand million in all."""
    for k in range(30):
        more = f'<include file="{k + 1}.xml"/>' * 2
        (tmp_path / f"{k}.xml").write_text(f"<mujoco>{more}<!--{'x' * 200_000}--></mujoco>")
    (tmp_path / "30.xml").write_text("<mujoco/>")
    with refused("too large"):
        read_source(tmp_path / "0.xml")


def test_arms_and_hands_are_told_apart(tmp_path):
    from foreign_parts import foreign_hand, six_joint_arm

    assert parts_of(foreign_hand(tmp_path)) == (True, False)
    assert parts_of(six_joint_arm(tmp_path)) == (False, True)
