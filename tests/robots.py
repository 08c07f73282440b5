"""The simulated cell and its robot, as tests name them."""

import mujoco
import yaml

from dexgrasp_env.assets import asset_path
from dexgrasp_env.robot.cell import default_cell

CELL = default_cell()
ROBOT = CELL.robot
HOME, LOWER, UPPER, VELOCITY, TORQUE = ROBOT.home, ROBOT.lower, ROBOT.upper, ROBOT.velocity, ROBOT.torque
JOINTS, BODIES = ROBOT.joints, ROBOT.bodies
ARM_JOINTS, HAND_JOINTS = ROBOT.arm.joints.names, ROBOT.hand.joints.names
ARM_BODIES = ROBOT.arm.bodies
FINGERS = tuple(finger.name for finger in ROBOT.hand.fingers)
GRASP_FINGERS = ROBOT.hand.grasp
TIPS = ROBOT.tips
MOUNTS = CELL.mounts


def denormalise(action, robot):
    """`joint_position` actions (..., n) as joint positions (..., n) rad."""
    return robot.lower + 0.5 * (action + 1.0) * (robot.upper - robot.lower)


def room(floor=True):
    """Return a table, and a floor under it."""
    spec, kinds = mujoco.MjSpec(), mujoco.mjtGeom
    table = spec.worldbody.add_body(name="table")
    table.add_geom(type=kinds.mjGEOM_BOX, size=[0.35, 0.6, 0.02], pos=[0.52, 0, -0.02])
    if floor:
        spec.worldbody.add_geom(type=kinds.mjGEOM_PLANE, size=[0, 0, 0.1], pos=[0, 0, -0.75])
    return spec


def simulated(spec):
    """Return a model, and its data with positions computed."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def variant(folder, of="panda_allegro", **changes):
    """Write a robot into a folder, entries of its file changed, or of its `hand` or `arm`, and return its path."""
    base = asset_path("robot", f"{of}.yaml") if isinstance(of, str) else of
    robot = yaml.safe_load(base.read_text())
    for key, change in changes.items():
        if isinstance(change, dict):
            part = yaml.safe_load((base.parent / robot[key]).read_text()) | change
            robot[key] = f"{key}.yaml"
            (folder / robot[key]).write_text(yaml.safe_dump(part))
        else:
            robot[key] = change
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot))
    return folder / "robot.yaml"
