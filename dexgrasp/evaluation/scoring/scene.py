"""A floating hand and an object in MuJoCo: the hand's base follows a mocap body through a weld, as in DexGraspBench.

Gravity is off for the hand; the object's weight, where there is one, is a force through its centre of mass.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.evaluation.scoring.hand import FloatingGrasp, HandModel, HandStage
from dexgrasp_env.arrays import Array
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.objects.mjcf import add_to_spec
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.poses import matrix_to_quat, pose_matrix

BASE, _MOCAP = "hand_base", "hand_target"


@dataclass(frozen=True)
class ContactPhysics:
    """Settings of contact and solver of a protocol.

    Attributes:
        friction: sliding coefficient of hand and object, and torsional, m.
        table_friction: sliding coefficient of the table; None for no table.
        servo_kp: Nm/rad of the servos of robots' hands; hands by path of an MJCF keep their own.
        timestep: s.
        impratio: friction-to-normal impedance.
    """

    friction: tuple[float, float] = (0.6, 0.02)
    table_friction: float | None = None
    servo_kp: float = 5.0
    timestep: float = 0.004
    impratio: float = 10.0


def build_model(hand: HandModel, target: ObjectModel, physics: ContactPhysics) -> mujoco.MjModel:
    """Compile the scene: bodies `hand_base` (free, welded to the mocap body), `object` (free), and a table or none."""
    spec = mujoco.MjSpec()
    spec.modelname = f"score {hand.name} {target.name}"
    _set_options(spec, physics)
    _add_hand(spec, hand, physics)
    body = spec.worldbody.add_body(name="object")
    body.add_freejoint(name="object")
    add_to_spec(spec, body, target, visual=False)
    if physics.table_friction is not None:
        spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    for geom in spec.geoms:
        sliding = physics.friction[0] if geom.name != "table" else physics.table_friction
        geom.friction = [sliding, physics.friction[1], 0.0001]
        geom.condim = 4
    return with_decimal_points(spec.compile)


def _set_options(spec: mujoco.MjSpec, physics: ContactPhysics) -> None:
    option = spec.option
    option.timestep, option.impratio = physics.timestep, physics.impratio
    option.noslip_iterations, option.tolerance, option.gravity = 2, 1e-8, [0.0, 0.0, 0.0]
    option.integrator, option.cone = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, mujoco.mjtCone.mjCONE_ELLIPTIC


def _add_hand(spec: mujoco.MjSpec, hand: HandModel, physics: ContactPhysics) -> None:
    child = hand.spec(physics.servo_kp)
    _set_options(child, physics)  # differing ones draw a warning
    for geom in child.geoms:
        geom.solimp[:3] = 0.5, 0.99, 0.0001
        geom.solref[:2] = 0.005, 1.0
    base = spec.worldbody.add_body(name=BASE)
    base.add_freejoint(name=BASE)
    spec.attach(child, frame=base.add_frame(), prefix="hand/")
    spec.worldbody.add_body(name=_MOCAP, mocap=True)
    same_pose = np.zeros(12)  # anchor 3, position 3, quaternion 4, torque scale, unused
    same_pose[[6, 10]] = 1.0
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_WELD, name1=_MOCAP, name2=BASE, objtype=mujoco.mjtObj.mjOBJ_BODY,
        data=same_pose, solimp=[0.9, 0.95, 0.001, 0.5, 2],
    )  # fmt: skip


class FloatingScene:
    """Simulation of one grasp."""

    def __init__(self, candidate: FloatingGrasp, physics: ContactPhysics, mass: float) -> None:
        """Build it.

        Args:
            candidate: the grasp.
            physics: of the protocol.
            mass: of the object, kg; its inertia goes with it.
        """
        self.candidate, self.mass = candidate, mass
        self.model = model = build_model(candidate.hand, candidate.object.with_mass(mass), physics)
        self.data = mujoco.MjData(model)
        self.servo_kp = physics.servo_kp if candidate.hand.part else None
        self._alone = mujoco.MjData(candidate.hand.model)
        self.object_body = model.body("object").id
        self.hand_bodies = np.flatnonzero(model.body_rootid == model.body(BASE).id).tolist()

    def reset(self, stage: HandStage) -> None:
        """Set the hand to a stage and the object to its initial pose, at rest, without forces."""
        mujoco.mj_resetData(self.model, self.data)
        object_pose = _seven(self.candidate.T_world_object)
        self.data.qpos[:] = np.concatenate([_seven(stage.T_world_hand), stage.joints, object_pose])
        mujoco.mj_forward(self.model, self.data)
        self.aim(stage.T_world_hand, stage.joints)

    def aim(self, T_world_hand: Array, joints: Array) -> None:
        """Set the set-points of base and joints."""
        seven = _seven(T_world_hand)
        self.data.mocap_pos[0], self.data.mocap_quat[0] = seven[:3], seven[3:]
        self.data.ctrl[:] = self._servo_inputs(joints)

    def _servo_inputs(self, joints: Array) -> Array:
        """Return the set-points (nu,) that hold joints (n,); a tendon's is the sum of its joints."""
        hand = self.candidate.hand
        if hand.part:
            return joints[[hand.joint_names.index(hand.model.actuator(k).name) for k in range(hand.model.nu)]]
        self._alone.qpos[:] = joints
        mujoco.mj_fwdPosition(hand.model, self._alone)
        return self._alone.actuator_length

    def push(self, force: Array) -> None:
        """Apply a force (3,) N through the object's centre of mass, world frame, until it is changed."""
        self.data.xfrc_applied[self.object_body, :3] = force

    def run(self, seconds: float) -> None:
        """Advance the simulation."""
        mujoco.mj_step(self.model, self.data, nstep=max(1, round(seconds / self.model.opt.timestep)))

    def move(self, start: HandStage, end: HandStage, seconds: float) -> None:
        """Move the set-points from one stage to the other in ten equal steps, as DexGraspBench does."""
        for part in np.arange(1, 11) / 10:
            T = interpolated(start.T_world_hand, end.T_world_hand, float(part))
            self.aim(T, start.joints + part * (end.joints - start.joints))
            self.run(seconds / 10)

    def pose(self, body: str = "object") -> Array:
        """Return the pose (4, 4) of the object, or of the hand's `BASE`, in the world frame."""
        return pose_matrix(self.data.body(body).xpos, self.data.body(body).xquat)

    def hand_contacts(self) -> list[tuple[int, float, float]]:
        """Return body of the hand, distance [m] and normal force [N] of each contact of hand and object."""
        found, force = [], np.zeros(6)
        for index in range(self.data.ncon):
            contact = self.data.contact[index]
            bodies = self.model.geom_bodyid[contact.geom].tolist()
            of_hand = [body for body in bodies if body in self.hand_bodies]
            if of_hand and self.object_body in bodies:
                mujoco.mj_contactForce(self.model, self.data, index, force)
                found.append((of_hand[0], float(contact.dist), float(force[0])))
        return found

    def penetration(self) -> float:
        """Return the deepest penetration of hand and object, m; 0 where they are apart."""
        return max((-distance for _, distance, _ in self.hand_contacts()), default=0.0)


def displacement(before: Array, after: Array) -> tuple[float, float]:
    """Return the distance (m) and the angle (rad) between two poses (4, 4)."""
    turn = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).magnitude()
    return float(np.linalg.norm(after[:3, 3] - before[:3, 3])), float(turn)


def interpolated(first: Array, last: Array, part: float) -> Array:
    """Return the pose (4, 4) at `part` between two: positions on a line, rotations about one axis."""
    T = first + part * (last - first)
    T[:3, :3] = first[:3, :3] @ (Rotation.from_matrix(first[:3, :3].T @ last[:3, :3]) ** part).as_matrix()
    return T


def _seven(T: Array) -> Array:
    return np.concatenate([T[:3, 3], matrix_to_quat(T[:3, :3])])
