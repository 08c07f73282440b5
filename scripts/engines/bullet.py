"""A scene of the environments in Bullet (PyBullet), whose solver and contacts share no code with MuJoCo's.

Bullet has no rotor inertia at the joints: that of the scene is added to the link's own about the joint's axis. It slows
motions, and has no part in the forces of a grasp at rest.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import inverse, matrix_to_quat, pose_matrix, quat_to_matrix
from dexgrasp_env.robot.model import colliding
from engines.scene import World, mesh_file, pairs_apart

# No drag, no bounce, and convex hulls as they are: Bullet would swell them by a millimetre. NB: with drag or margin
# named, `changeDynamics` sets the base, whatever link it is given.
_EXACT = {"linearDamping": 0.0, "angularDamping": 0.0, "restitution": 0.0, "collisionMargin": 0.0}
STEP = 0.00025
"""s, of the physics: Bullet takes the torques of the wrist's stiff dampers explicitly. At 0.5 ms they chatter and shake
heavy objects out of the hand."""
_PENETRATION_TIME = 0.02
"""s in which bodies that overlap are pushed apart, as the scene's contacts have it."""
_ITERATIONS = 100


class Bullet(World):
    """A scene in Bullet: the robot under its servos, the object free; the joints in the order of the model's."""

    step_seconds = STEP

    def __init__(self, model: mujoco.MjModel, start: Array, pose: Array) -> None:
        """Set the robot at joint angles (23,), rad, and the object at a pose (7,): position, quaternion wxyz."""
        import pybullet as client

        self.client, self._world, self._model = client, client.connect(client.DIRECT), model
        client.setGravity(*model.opt.gravity.tolist())
        client.setPhysicsEngineParameter(
            fixedTimeStep=STEP, numSolverIterations=_ITERATIONS, contactERP=STEP / _PENETRATION_TIME,
            enableConeFriction=1,
        )  # fmt: skip
        self.robot, self.object = add_bodies(client, model)
        self._joints = [int(body) - 2 for body in model.jnt_bodyid[: len(start)]]
        for joint, angle in zip(self._joints, start.tolist(), strict=True):
            client.resetJointState(self.robot, joint, angle)
        zero = [0.0] * len(start)
        client.setJointMotorControlArray(self.robot, self._joints, client.VELOCITY_CONTROL, forces=zero)
        body = model.body("object").id
        self._inertial = pose_matrix(model.body_ipos[body], model.body_iquat[body])
        place = pose_matrix(pose[:3], pose[3:]) @ self._inertial
        client.resetBasePositionAndOrientation(self.object, *_of_bullet(place))

    def close(self) -> None:
        """Give its memory back."""
        self.client.disconnect(self._world)

    def position(self) -> Array:
        """Return the place of the object's frame (3,), m."""
        position, (x, y, z, w) = self.client.getBasePositionAndOrientation(self.object)
        place = pose_matrix(np.array(position), np.array([w, x, y, z])) @ inverse(self._inertial)
        return place[:3, 3]

    def joints(self) -> Array:
        """Return the robot's joint angles (n,), rad."""
        return np.array([state[0] for state in self.client.getJointStates(self.robot, self._joints)])

    def step(self, target: Array) -> None:
        """One step under the scene's servos (23,)."""
        client, model = self.client, self._model
        states = client.getJointStates(self.robot, self._joints)
        angles, speeds = np.array([state[0] for state in states]), np.array([state[1] for state in states])
        servo = model.actuator_gainprm[:, 0] * target + model.actuator_biasprm[:, 1] * angles
        servo += model.actuator_biasprm[:, 2] * speeds
        still = [0.0] * len(angles)
        weight = np.array(client.calculateInverseDynamics(self.robot, angles.tolist(), still, still))
        servo = np.clip(servo, *model.actuator_forcerange.T) + weight
        torque = np.clip(servo, *model.jnt_actfrcrange[: len(angles)].T)
        client.setJointMotorControlArray(
            self.robot, self._joints, client.TORQUE_CONTROL, forces=torque.tolist()
        )
        client.stepSimulation()


def add_bodies(client: Any, model: mujoco.MjModel) -> tuple[int, int]:
    """Put table, robot and object into a Bullet world.

    Args:
        client: PyBullet's functions, for one world.
        model: of an exported scene.

    Returns:
        The ids of the robot, whose link k is body k + 2 of the model, and of the object, whose frame is its inertia's.
    """
    with TemporaryDirectory() as folder:
        table = model.body("table").id
        _add_free(client, model, table, Path(folder), fixed=True)
        robot = _add_robot(client, model, table, Path(folder))
        held = _add_free(client, model, model.body("object").id, Path(folder), fixed=False)
    return robot, held


def _add_free(client: Any, model: mujoco.MjModel, body: int, folder: Path, *, fixed: bool) -> int:
    """The table or the object, in its inertial frame. Bullet multiplies frictions: the object has 1, the rest mu."""
    frame = pose_matrix(model.body_ipos[body], model.body_iquat[body])
    shape = _collision_shape(client, model, body, folder, frame)
    position, quat = _of_bullet(pose_matrix(model.body_pos[body], model.body_quat[body]) @ frame)
    mass = 0.0 if fixed else float(model.body_mass[body])
    made = client.createMultiBody(mass, shape, basePosition=position, baseOrientation=quat)
    friction = _friction(model, body) if fixed else 1.0
    client.changeDynamics(made, -1, lateralFriction=friction, **_EXACT)
    if not fixed:
        client.changeDynamics(made, -1, localInertiaDiagonal=model.body_inertia[body].tolist())
    return int(made)


def _add_robot(client: Any, model: mujoco.MjModel, end: int, folder: Path) -> int:
    """The bodies 1 to `end` - 1: the first is the base, which is the world's frame."""
    links = range(2, end)
    inertials = {body: _with_rotor(model, body) for body in links}
    robot = client.createMultiBody(
        0.0, _collision_shape(client, model, 1, folder, np.eye(4)),
        basePosition=model.body_pos[1].tolist(), baseOrientation=_xyzw(model.body_quat[1]),
        linkMasses=[float(model.body_mass[b]) for b in links],
        linkCollisionShapeIndices=[_collision_shape(client, model, b, folder, np.eye(4)) for b in links],
        linkVisualShapeIndices=[-1 for _ in links],
        linkPositions=[model.body_pos[b].tolist() for b in links],
        linkOrientations=[_xyzw(model.body_quat[b]) for b in links],
        linkInertialFramePositions=[model.body_ipos[b].tolist() for b in links],
        linkInertialFrameOrientations=[_xyzw(inertials[b][1]) for b in links],
        linkParentIndices=[int(model.body_parentid[b]) - 1 for b in links],
        linkJointTypes=[client.JOINT_REVOLUTE if model.body_jntnum[b] else client.JOINT_FIXED for b in links],
        linkJointAxis=[_axis(model, b).tolist() for b in links],
        flags=client.URDF_USE_SELF_COLLISION,
    )  # fmt: skip
    # NB: first, as Bullet's inverse dynamics refuses a rotor's inertia, but keeps the links that it has seen.
    still = [0.0] * int(np.count_nonzero(model.body_jntnum[1:end]))
    client.calculateInverseDynamics(robot, still, still, still)
    client.changeDynamics(robot, -1, lateralFriction=_friction(model, 1), **_EXACT)
    for body in links:
        client.changeDynamics(
            robot, body - 2, lateralFriction=_friction(model, body), restitution=0.0, jointDamping=0.0,
            localInertiaDiagonal=inertials[body][0].tolist(),
        )  # fmt: skip
        if model.body_jntnum[body]:
            lower, upper = model.jnt_range[model.body_jntadr[body]].tolist()
            client.changeDynamics(robot, body - 2, jointLowerLimit=lower, jointUpperLimit=upper)
    for first, second in pairs_apart(model, end):
        client.setCollisionFilterPair(robot, robot, first - 2, second - 2, 0)
    return int(robot)


def _friction(model: mujoco.MjModel, body: int) -> float:
    """Sliding coefficient of what collides of a body."""
    return float(model.geom_friction[colliding(model, body)[0], 0])


def _axis(model: mujoco.MjModel, body: int) -> Array:
    return model.jnt_axis[model.body_jntadr[body]] if model.body_jntnum[body] else np.array([0.0, 0.0, 1.0])


def _with_rotor(model: mujoco.MjModel, body: int) -> tuple[Array, Array]:
    """Principal moments (3,) and their frame (wxyz) of a link and its joint's rotor."""
    R = quat_to_matrix(model.body_iquat[body])
    inertia = R @ np.diag(model.body_inertia[body]) @ R.T
    if model.body_jntnum[body]:
        axis = _axis(model, body)
        inertia += float(model.dof_armature[model.body_dofadr[body]]) * np.outer(axis, axis)
    moments, frame = np.linalg.eigh(inertia)
    return moments, matrix_to_quat(frame * [1.0, 1.0, np.sign(np.linalg.det(frame))])


def _collision_shape(client: Any, model: mujoco.MjModel, body: int, folder: Path, frame: Array) -> int:
    """All that collides of a body as one shape, seen from a frame (4, 4) of the body."""
    geoms = colliding(model, body)
    sizes = model.geom_size
    kinds = {
        mujoco.mjtGeom.mjGEOM_SPHERE: client.GEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE: client.GEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_CYLINDER: client.GEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_BOX: client.GEOM_BOX,
        mujoco.mjtGeom.mjGEOM_MESH: client.GEOM_MESH,
    }  # fmt: skip
    back = inverse(frame)
    places = [_of_bullet(back @ pose_matrix(model.geom_pos[g], model.geom_quat[g])) for g in geoms]
    return int(
        client.createCollisionShapeArray(
            shapeTypes=[kinds[mujoco.mjtGeom(model.geom_type[g])] for g in geoms],
            radii=[float(sizes[g, 0]) for g in geoms],
            lengths=[2.0 * float(sizes[g, 1]) for g in geoms],
            halfExtents=[sizes[g].tolist() for g in geoms],
            fileNames=[mesh_file(model, g, folder) for g in geoms],
            meshScales=[[1.0, 1.0, 1.0] for _ in geoms],
            collisionFramePositions=[position for position, _ in places],
            collisionFrameOrientations=[quat for _, quat in places],
        )
    )


def _xyzw(quat_wxyz: Array) -> list[float]:
    w, x, y, z = quat_wxyz.tolist()
    return [x, y, z, w]


def _of_bullet(T: Array) -> tuple[list[float], list[float]]:
    """Return a pose (4, 4) as Bullet takes it: position, m, and quaternion xyzw."""
    return T[:3, 3].tolist(), _xyzw(matrix_to_quat(T[:3, :3]))
