"""The robot as a MuJoCo specification: the arm with the hand on its flange."""

import itertools
from functools import lru_cache

import mujoco

from dexgrasp_env.assets import asset_path
from dexgrasp_env.robot.cell import Cell, active_cell
from dexgrasp_env.robot.mounts import Mount, find_mount
from dexgrasp_env.robot.names import ARM_BODIES, ARM_JOINTS, HAND_JOINTS

FLANGE_OFFSET = 0.107
"""Of the flange from link 7's frame along z7, m."""
_ADAPTER_END = 0.122
_PREFIX = "hand/"


def robot_spec(mount: str = "palm_normal") -> mujoco.MjSpec:
    """Build the Panda with the Allegro hand where the cell has its base in the world, names as in `names`.

    Args:
        mount: how the hand sits on the flange, a key of `mounts.MOUNTS`.

    Returns:
        A specification that can be compiled as it is or attached to a scene.

    Raises:
        InputError: if the mount is not known.
    """
    placement = find_mount(mount)
    arm = mujoco.MjSpec.from_file(str(asset_path("robot", "panda.xml")))
    hand = mujoco.MjSpec.from_file(str(asset_path("robot", "allegro.xml")))
    arm.modelname = "panda_allegro"
    _attach_hand(arm, hand, placement)
    arm.body(ARM_BODIES[0]).pos = active_cell().base
    _set_limits(arm, active_cell())
    return arm


@lru_cache(maxsize=4)
def compiled_robot(mount: str = "palm_normal") -> mujoco.MjModel:
    """Return the robot alone, compiled; the same model at every call, not to be written to.

    Raises:
        InputError: if the mount is not known.
    """
    return robot_spec(mount).compile()


def _attach_hand(arm: mujoco.MjSpec, hand: mujoco.MjSpec, mount: Mount) -> None:
    link = arm.body("panda_link7")
    _add_adapter(arm, link)
    frame = link.add_frame(pos=mount.position, quat=mount.quat_wxyz)
    arm.attach(hand, frame=frame, prefix=_PREFIX)
    _strip_prefix(arm)
    arm.add_exclude(bodyname1="panda_link7", bodyname2="palm")


def _set_limits(robot: mujoco.MjSpec, cell: Cell) -> None:
    """Give joints and servos the cell's ranges, torques and gains; dampings of the hand stay critical."""
    for names, part in ((ARM_JOINTS, cell.arm), (HAND_JOINTS, cell.hand)):
        for k, name in enumerate(names):
            joint, servo, most = robot.joint(name), robot.actuator(name), part.torque[k]
            joint.range = [part.lower[k], part.upper[k]]
            joint.actfrcrange = servo.forcerange = [-most, most]
            servo.gainprm[0], servo.biasprm[1] = part.stiffness[k], -part.stiffness[k]
            if part.damping:
                servo.biasprm[2] = -part.damping[k]


def _strip_prefix(spec: mujoco.MjSpec) -> None:
    """Give the attached parts their own names back, and mend the references to them.

    NB: attaching with an empty prefix gives the same names, but MuJoCo then warns at every compilation,
    writes a log file where the user stands and saves an XML that it cannot read.
    """
    named = (spec.bodies, spec.joints, spec.geoms, spec.sites, spec.materials, spec.meshes, spec.actuators)
    for element in itertools.chain(*named):
        element.name = element.name.removeprefix(_PREFIX)
    for geom in spec.geoms:
        geom.material = geom.material.removeprefix(_PREFIX)
        geom.meshname = geom.meshname.removeprefix(_PREFIX)
    for actuator in spec.actuators:
        actuator.target = actuator.target.removeprefix(_PREFIX)
    for exclude in spec.excludes:
        exclude.bodyname1 = exclude.bodyname1.removeprefix(_PREFIX)
        exclude.bodyname2 = exclude.bodyname2.removeprefix(_PREFIX)


def _add_adapter(arm: mujoco.MjSpec, link: mujoco.MjsBody) -> None:
    """Show the plate between the flange and the hand."""
    half = (_ADAPTER_END - FLANGE_OFFSET) / 2
    link.add_geom(
        arm.find_default("panda_visual"),
        name="adapter",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        pos=(0.0, 0.0, FLANGE_OFFSET + half),
        size=(0.0315, half, 0.0),
        material="panda_metal",
    )
