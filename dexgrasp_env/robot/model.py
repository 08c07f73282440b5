"""The robot as a MuJoCo specification: the arm with the hand on its flange."""

import itertools
from collections.abc import Iterable, Iterator
from copy import copy
from functools import lru_cache

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.errors import InputError
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.poses import matrix_to_quat, quat_multiply
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.description import bearers
from dexgrasp_env.robot.rebuilt import described, solids_of
from dexgrasp_env.robot.robot import Adapter, Arm, Hand, Joints, Robot, Tendon


def robot_spec(cell: Cell) -> mujoco.MjSpec:
    """Build the arm with its hand where the cell has its base in the world, names as in the robot's files.

    Returns:
        A specification that can be compiled as it is or attached to a scene.

    Raises:
        InputError: for a description that lacks what its file names.
    """
    robot, arm, hand = cell.robot, cell.robot.arm, cell.robot.hand
    spec, other = described(arm), described(hand)
    _check_names(spec, arm, body=arm.bodies)
    boxes = [hand.palm] if hand.frame is None else []
    boxes += [hand.beside_palm] if hand.beside_palm else []
    sites = [hand.palm, *robot.tips]
    _check_names(other, hand, body=hand.bodies, site=sites, geom=[*robot.tips, *boxes])
    spec.modelname, other.option = robot.name, spec.option  # a hand may be of other options than an arm
    link = spec.body(arm.bodies[-1])
    if arm.adapter:
        _add_adapter(spec, link, arm.adapter)
    attach(spec, other, link.add_frame(pos=robot.mount.position, quat=robot.mount.quat_wxyz))
    spec.add_exclude(bodyname1=link.name, bodyname2=hand.palm)
    _stand(spec.body(arm.bodies[0]), cell)
    set_limits(spec, arm.joints)
    set_drives(spec, hand)
    return spec


def colliding_spec(cell: Cell) -> mujoco.MjSpec:
    """Build the robot without what is only seen."""
    return solids_of(robot_spec(cell))


def _stand(base: mujoco.MjsBody, cell: Cell) -> None:
    """Put a robot's base where the cell has it in the world."""
    base.pos = cell.base
    if cell.table is not None:
        base.quat = _turned(np.array(base.quat), cell)


def set_drives(spec: mujoco.MjSpec, hand: Hand) -> None:
    """Give a hand's joints and servos their limits and gains, and couple those that do not move alone."""
    set_limits(spec, hand.joints)
    for own in hand.couplings:
        equal = spec.add_equality(
            name=own.joint, type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=own.joint,
            name2=own.follows, solref=(0.004, 1.0),  # two physics steps: as stiff as is stable
        )  # fmt: skip
        equal.data[:2] = own.offset, own.ratio
    for tendon in hand.tendons:
        _add_tendon(spec, tendon)


def _add_tendon(spec: mujoco.MjSpec, tendon: Tendon) -> None:
    """Add a tendon pulled by the servo of the last joint; the others' servos add their set-points' share of its length.

    So set-points are one a joint here as elsewhere. Torques are limited at the joints.
    """
    name = f"{tendon.joints[-1]}_tendon"
    wrapped = spec.add_tendon(name=name)
    for joint, coef in zip(tendon.joints, tendon.coefs, strict=True):
        wrapped.wrap_joint(joint, coef)
        servo = spec.actuator(joint)
        servo.trntype, servo.target, servo.inheritrange = mujoco.mjtTrn.mjTRN_TENDON, name, 0.0
        servo.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE
        servo.ctrllimited, servo.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, spec.joint(joint).range
        if joint != tendon.joints[-1]:
            servo.gainprm[0] = coef * spec.actuator(tendon.joints[-1]).gainprm[0]
            servo.biastype, servo.biasprm[:3] = mujoco.mjtBias.mjBIAS_NONE, 0.0


@lru_cache(maxsize=8)
def compiled_robot(cell: Cell) -> mujoco.MjModel:
    """Return the robot alone, compiled; the same model at every call, not to be written to.

    Where a cell sees its table, it is the model of the cell without, its base moved: its kinematics are exact, what a
    compiler derives from them (`stat`, `invweight0`) is of the base where it was.

    Raises:
        InputError: for a description that MuJoCo cannot compile.
    """
    if cell.table is not None:
        return _moved(compiled_robot(cell.seeing(None)), cell)
    try:
        model = with_decimal_points(robot_spec(cell).compile)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"robot {cell.robot.name!r}: {' '.join(str(error).split())[:200]}") from None
    _check_physical(model, cell.robot)
    return model


def _moved(model: mujoco.MjModel, cell: Cell) -> mujoco.MjModel:
    """Return a copy of a robot's model whose base is where a cell that sees its table has it in the world."""
    model, base = copy(model), model.body(cell.robot.arm.bodies[0]).id
    model.body_pos[base] = cell.base
    model.body_quat[base] = _turned(model.body_quat[base], cell)
    mujoco.mju_normalize4(model.body_quat[base])
    return model


def _turned(quat: Array, cell: Cell) -> Array:
    """Return the orientation of a base, which has one (4,) of its own, in the world of a table that was seen."""
    return quat_multiply(matrix_to_quat(cell.T_world_base[:3, :3]), quat)


def _check_physical(model: mujoco.MjModel, robot: Robot) -> None:
    """Refuse what MuJoCo compiles and no robot is: it would only diverge when it moves."""
    m = model
    lengths = m.body_pos, m.body_ipos, m.geom_pos, m.geom_size, m.site_pos
    for what, least, most, values in (
        ("a length", -10.0, 10.0, lengths),  # m
        ("a mass", 0.0, 1e3, (m.body_mass,)),
        ("an inertia", 0.0, 1e3, (m.body_inertia, m.dof_armature)),
        ("a damping or friction", 0.0, 1e5, (m.dof_damping, m.dof_frictionloss, m.jnt_stiffness)),
    ):
        found = np.nan_to_num(np.concatenate([v.ravel() for v in values]), nan=np.inf)
        low, high = found.min(initial=0.0), found.max(initial=0.0)
        if low < least or high > most:
            worst = high if high > most else low
            raise InputError(
                f"robot {robot.name!r}: {what} of {worst:.3g} in its descriptions: valid is {least:g} to {most:g}"
            )


def _check_names(spec: mujoco.MjSpec, part: Arm | Hand, **named: Iterable[str]) -> None:
    """Refuse a description that lacks what its file names, a servo for each joint among it."""
    joints = part.joints.names
    for kind, names in {"joint": joints, "actuator": joints, **named}.items():
        for name in names:
            if getattr(spec, kind)(name) is None:
                raise InputError(f"{part.mjcf} has no {kind} {name!r}, which {part.name!r} names")
    for servo in spec.actuators:
        aimless = servo.trntype == mujoco.mjtTrn.mjTRN_UNDEFINED
        if aimless or (servo.trntype == mujoco.mjtTrn.mjTRN_JOINT and spec.joint(servo.target) is None):
            raise InputError(f"{part.mjcf}: actuator {servo.name!r} moves no joint of it")


def set_limits(spec: mujoco.MjSpec, part: Joints) -> None:
    """Give joints and servos their ranges, torques and gains; dampings that none states stay critical."""
    for k, name in enumerate(part.names):
        joint, servo, most = spec.joint(name), spec.actuator(name), part.torque[k]
        joint.range = part.ranges[:, k]
        joint.actfrcrange = servo.forcerange = [-most, most]
        servo.gainprm[0], servo.biasprm[1] = part.stiffness[k], -part.stiffness[k]
        if part.damping:
            servo.biasprm[2] = -part.damping[k]


def attach(spec: mujoco.MjSpec, other: mujoco.MjSpec, frame: mujoco.MjsFrame) -> None:
    """Attach all of another specification to a frame; its parts keep their names.

    NB: attaching with an empty prefix gives the same names, but MuJoCo then warns at every compilation,
    writes a log file where the user stands and saves an XML that it cannot read. Default classes keep the prefix,
    so that of each attachment is another.
    """
    prefix = f"attached{len(spec.bodies)}/"
    spec.attach(other, frame=frame, prefix=prefix)
    parts = (
        spec.bodies, spec.joints, spec.geoms, spec.sites, spec.lights, spec.textures, spec.materials, spec.meshes,
        spec.actuators, spec.excludes,
    )  # fmt: skip
    for element in itertools.chain(*parts):
        for name in ("name", "material", "meshname", "target", "bodyname1", "bodyname2"):
            if hasattr(element, name):
                setattr(element, name, getattr(element, name).removeprefix(prefix))
    for material in spec.materials:
        material.textures = [name.removeprefix(prefix) for name in material.textures]


def _add_adapter(arm: mujoco.MjSpec, link: mujoco.MjsBody, adapter: Adapter) -> None:
    """Show the plate between the flange and the hand."""
    half = (adapter.end - adapter.start) / 2
    link.add_geom(
        arm.find_default(adapter.look),
        name="adapter",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        pos=(0.0, 0.0, adapter.start + half),
        size=(adapter.radius, half, 0.0),
        material=adapter.material,
    )


def excluded_pairs(model: mujoco.MjModel) -> set[frozenset[int]]:
    """Return the pairs of bodies that a description excludes from colliding."""
    return {frozenset(divmod(pair, 1 << 16)) for pair in model.exclude_signature.tolist()}


def posed(model: mujoco.MjModel, q: Array) -> mujoco.MjData:
    """Return where the bodies of a model are with its joints at `q` (n,) rad."""
    return next(swept(model, [q]))


def swept(model: mujoco.MjModel, postures: Iterable[Array]) -> Iterator[mujoco.MjData]:
    """Yield where the bodies of a model are in each of postures (n,) rad; what is yielded is used again."""
    data = mujoco.MjData(model)
    for q in postures:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        yield data


def bodies_apart(data: mujoco.MjData, a: int, b: int, most: float) -> float:
    """Return how far what collides of two bodies is apart, m, but `most` at most; less than 0 where they overlap."""
    model, nothing = data.model, np.zeros(6)
    pairs = itertools.product(colliding(model, a), colliding(model, b))
    return min((mujoco.mj_geomDistance(model, data, *pair, most, nothing) for pair in pairs), default=most)


def colliding(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the geoms of a body that collide."""
    return [g for g in np.flatnonzero(model.geom_bodyid == body).tolist() if model.geom_contype[g]]


def joints_between(model: mujoco.MjModel, a: int, b: int) -> Index:
    """Return the joints that move two bodies against each other."""
    between = {*bearers(model, a)} ^ {*bearers(model, b)}
    return np.flatnonzero([body in between for body in model.jnt_bodyid])
