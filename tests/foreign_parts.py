"""Hands and arms as somebody else would describe them, written by the tests that take them in."""

import mujoco
from tables import table

from dexgrasp_env.assets import asset_path

ALLEGRO = asset_path("robot", "allegro.xml")


def foreign_hand(folder):
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


_SIX = table("six_joints")
"""Where each joint of an arm like a UR5 sits in the body before, and its axis."""


def six_joint_arm(folder):
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
