"""A hand of your own: a robot file made of MJCF, and an environment with that robot."""

import subprocess
import sys
from pathlib import Path

import gymnasium as gym

import dexgrasp_env  # noqa: F401  (registers the environments)

HEAD = """<mujoco model="claw"><compiler angle="radian"/>
<default>
  <joint axis="0 1 0" range="0 1.6" actuatorfrcrange="-1 1" damping="0.02"/>
  <geom type="capsule" size="0.01" mass="0.03"/>
  <default class="spread"><joint axis="1 0 0" range="-0.5 0.5"/></default>
</default>
<worldbody><body name="plate"><geom type="box" size="0.012 0.045 0.05" pos="0 0 -0.05" mass="0.4"/>"""
FINGER = """<body name="{0}_base" {1}>
  <joint name="{0}_spread" class="spread"/><geom fromto="0 0 0 0 0 0.02"/>
  <body name="{0}_near" pos="0 0 0.02"><joint name="{0}_flex" range="{2}"/><geom fromto="0 0 0 0 0 0.055"/>
    <body name="{0}_far" pos="0 0 0.055"><joint name="{0}_curl"/><geom fromto="0 0 0 0 0 0.045"/></body>
  </body>
</body>"""


def claw() -> str:
    """Return the MJCF of two fingers and a thumb on a plate."""
    fingers = (
        ("left", 'pos="0 0.03 0"', "0 1.6"),
        ("right", 'pos="0 -0.03 0"', "0 1.6"),
        ("thumb", 'pos="0.01 0 -0.08" xyaxes="0 0 1 0 -1 0"', "-0.8 1.2"),
    )
    return HEAD + "".join(FINGER.format(*finger) for finger in fingers) + "</body></worldbody></mujoco>"


# Make the robot file and print the sizes of its environment.
Path("out").mkdir(exist_ok=True)
Path("out/claw.xml").write_text(claw())
command = [sys.executable, "-m", "dexgrasp_env", "robot", "make"]
subprocess.run([*command, "--hand", "out/claw.xml", "--out", "out/claw.yaml"], check=True)
env = gym.make("DexGrasp/Lift-v2", objects="pear", robot="out/claw.yaml")
env.reset(seed=0)
print("joints:", env.action_space.shape)  # seven of the arm and nine of the hand
env.close()
