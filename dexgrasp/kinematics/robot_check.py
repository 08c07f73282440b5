"""A robot tested before anything is planned with it: the faults of users' files, each with its mend."""

from collections.abc import Iterator

import mujoco
import numpy as np

from dexgrasp.kinematics.forward import body_frames, fingertips
from dexgrasp.kinematics.palm_ik import reach_palm
from dexgrasp.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array
from dexgrasp_env.findings import Finding
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.model import robot_spec
from dexgrasp_env.scene.arena import read_arena

_ROUNDING = 1e-12  # m and of directions: two ways to compute a frame differ by less
_PUSH, _STEPS = 0.1, 400  # rad that a set-point moves, and physics steps until the joint has followed
_FOLLOWS, _STRAYS = 0.8, 0.3  # share of it that a joint follows at least, and another strays at most
_OFF = 0.004  # m that a tip's surface may be from its sphere
_PINCH = 5.0  # N that a finger should be able to press with
_REACHED = 0.5  # share of palm poses over the table that the arm should reach


def check_robot(cell: Cell) -> list[Finding]:
    """Return what is found of a cell's robot: errors have to be mended, warnings looked at."""
    checks = (_order, _kinematics, _home, _authority, _tips, _opposition, _strength, _reach)
    model = _alone(cell)
    return [finding for check in checks for finding in check(cell, model)]


def _alone(cell: Cell) -> mujoco.MjModel:
    spec = robot_spec(cell)
    spec.option = read_arena().option
    return spec.compile()


def _at(model: mujoco.MjModel, q: Array) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = data.ctrl[:] = q
    mujoco.mj_forward(model, data)
    return data


def _order(cell: Cell, model: mujoco.MjModel) -> Iterator[Finding]:
    robot = cell.robot
    for what, found in (
        ("joints", [model.joint(j).name for j in range(model.njnt)]),
        ("actuators", [model.actuator(a).name for a in range(model.nu)]),
    ):
        if found == list(robot.joints):
            yield Finding("info", f"{len(found)} {what} in the order of the file")
        else:
            yield Finding("error", f"{what} are {', '.join(found)}", f"name these: {', '.join(robot.joints)}")


def _kinematics(cell: Cell, model: mujoco.MjModel) -> Iterator[Finding]:
    robot, tree, worst = cell.robot, robot_tree(cell), 0.0
    for q in np.random.default_rng(0).uniform(robot.lower, robot.upper, (50, robot.dof)):
        data, frames = _at(model, q), body_frames(q, tree)
        for b, name in enumerate(robot.bodies):
            worst = max(worst, float(np.abs(frames.p[b] - data.body(name).xpos).max()))
            worst = max(worst, float(np.abs(frames.R[b] - data.body(name).xmat.reshape(3, 3)).max()))
    good = worst < _ROUNDING
    mend = "" if good else "joints have to sit at their bodies' origins and to be hinges"
    yield Finding("info" if good else "error", f"kinematics and simulation differ by {worst:.0e}", mend)


def _home(cell: Cell, model: mujoco.MjModel) -> Iterator[Finding]:
    data = _at(model, cell.robot.home)
    touching = {
        " and ".join(sorted(model.body(model.geom_bodyid[g]).name for g in contact.geom))
        for contact in data.contact
    }
    for pair in sorted(touching):
        yield Finding(
            "error", f"{pair} touch with the hand open", "change `open` of the hand, or exclude the pair"
        )
    if not touching:
        yield Finding("info", "nothing touches with the arm at home and the hand open")


def _authority(cell: Cell, model: mujoco.MjModel) -> Iterator[Finding]:
    """Each servo alone moves its own joint, and no other."""
    robot, start = cell.robot, cell.robot.home
    wrong = 0
    for j, name in enumerate(robot.joints):
        data = _at(model, start)
        sign = 1.0 if robot.upper[j] - start[j] > _PUSH else -1.0
        data.ctrl[j] += sign * _PUSH
        mujoco.mj_step(model, data, _STEPS)
        moved = (data.qpos - start) * sign / _PUSH
        strays = np.delete(np.abs(moved), j)
        if moved[j] < _FOLLOWS:
            wrong += 1
            mend = "raise its stiffness or torque, or look for a second servo that holds it"
            yield Finding("error", f"joint {name} follows its servo by {100 * moved[j]:.0f} %", mend)
        elif strays.max() > _STRAYS:
            wrong += 1
            other = np.delete(np.array(robot.joints), j)[int(np.argmax(strays))]
            yield Finding(
                "error", f"servo {name} moves joint {other}", "one servo a joint, of the joint's name"
            )
    if not wrong:
        yield Finding("info", "every servo moves its joint, and no other")


def _tips(cell: Cell, model: mujoco.MjModel) -> Iterator[Finding]:
    """The surface of each grasping tip is a radius from its site, out of the tip and out of its pad."""
    data, radius = _at(model, cell.robot.home), cell.robot.hand.tip_radius
    for finger in cell.robot.grasping:
        site, body = data.site(finger.tip), data.body(finger.bodies[-1])
        pad = body.xmat.reshape(3, 3) @ finger.pad
        for what, way in (("end", site.xmat.reshape(3, 3)[:, 2]), ("pad", pad)):
            depth = _surface(model, data, model.geom(finger.tip).id, site.xpos, way)
            if abs(depth - radius) > _OFF:
                mend = f"shift the tip's frame, or change tip_radius, {1000 * radius:.1f} mm"
                yield Finding(
                    "error", f"the {what} of {finger.tip} is {1000 * depth:.1f} mm from its centre", mend
                )
            else:
                yield Finding("info", f"the {what} of {finger.tip} is {1000 * depth:.1f} mm from its centre")


def _surface(model: mujoco.MjModel, data: mujoco.MjData, geom: int, centre: Array, way: Array) -> float:
    """How far a geom reaches from a point along a direction, m: what a ray from outside meets."""
    normal, far = np.zeros(3), 0.1
    start, R = centre + far * way, data.geom_xmat[geom].reshape(3, 3)
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        hit = mujoco.mj_rayMesh(model, data, geom, start, -way, normal)
    else:
        at, size = data.geom_xpos[geom], model.geom_size[geom]
        hit = mujoco.mju_rayGeom(at, R.ravel(), size, start, -way, int(model.geom_type[geom]), normal)
    return far - hit if hit >= 0 else far


def _opposition(cell: Cell, model: mujoco.MjModel) -> Iterator[Finding]:
    """The open hand's tips are in front of the palm, and the first one's pad faces the others."""
    data = _at(model, cell.robot.home)
    palm = data.site(cell.robot.hand.palm)
    front = (fingertips(cell.robot.home, robot_tree(cell)) - palm.xpos) @ palm.xmat.reshape(3, 3)[:, 0]
    if front.min() < 0.02:
        mend = "the palm frame's x has to point out of the palm's face; or bend `open` further"
        yield Finding("error", f"an open tip is {1000 * front.min():.0f} mm in front of the palm", mend)
    tips = np.array([data.site(finger.tip).xpos for finger in cell.robot.grasping])
    pads = [data.body(f.bodies[-1]).xmat.reshape(3, 3) @ f.pad for f in cell.robot.grasping]
    between = tips[1:].mean(0) - tips[0]
    facing = float(pads[0] @ between / np.linalg.norm(between))
    if facing < 0.0:
        mend = "x of a tip's frame has to point out of its pad; or change `open`, or which finger is first in `grasp`"
        yield Finding("error", f"the pad of {cell.robot.hand.grasp[0]} looks away from the others", mend)
    else:
        yield Finding("info", f"open, the tips of a grasp are {1000 * np.linalg.norm(between):.0f} mm apart")


def _strength(cell: Cell, model: mujoco.MjModel) -> Iterator[Finding]:
    """What a finger can press with, and what the arm has left of its torque at home."""
    robot, data, J = cell.robot, _at(model, cell.robot.home), np.zeros((3, model.nv))
    for finger in robot.grasping:
        body = data.body(finger.bodies[-1])
        mujoco.mj_jac(model, data, J, None, data.site(finger.tip).xpos, body.id)
        lever = np.abs(body.xmat.reshape(3, 3) @ finger.pad @ J)[robot.arm_dof :]
        force = float((robot.torque[robot.hand_columns] / np.maximum(lever, 1e-9)).min())
        level = "warning" if force < _PINCH else "info"
        mend = "torque of its joints, Nm: heavy objects will be beyond it" if level == "warning" else ""
        yield Finding(level, f"{finger.name} can press with {force:.1f} N", mend)
    share = np.abs(data.qfrc_bias[: robot.arm_dof]) / robot.torque[: robot.arm_dof]
    if share.max() > 0.9:
        name = robot.joints[int(share.argmax())]
        yield Finding(
            "error",
            f"{name} needs {100 * share.max():.0f} % of its torque at home",
            "state the maker's torque",
        )


def _reach(cell: Cell, model: mujoco.MjModel) -> Iterator[Finding]:
    """Palms that look down on the middle of the table."""
    tree, down, reached, total = robot_tree(cell), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), 0, 0
    for x in (0.4, 0.5, 0.6):
        for y in (-0.2, 0.0, 0.2):
            for yaw in np.linspace(-np.pi, np.pi, 6, endpoint=False):
                c, s = np.cos(yaw), np.sin(yaw)
                turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
                total += 1
                reached += reach_palm(tree.home.copy(), turn @ down, np.array([x, y, 0.2]), tree)
    good = reached >= _REACHED * total
    mend = "" if good else "change the arm's `home`, or the mount: palms look along its flange"
    yield Finding(
        "info" if good else "error", f"{reached} of {total} palm poses over the table are reached", mend
    )
