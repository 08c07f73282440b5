"""Plays an exported trajectory in Bullet (PyBullet), whose solver and contacts share no code with MuJoCo's.

    pip install -c constraints.txt pybullet
    dexgrasp export grasps/pear/grasp.json --format mjcf --out robot/pear
    python scripts/replay_bullet.py robot/pear --replay 5

The bodies are those of `scene.xml` as MuJoCo compiles it: shapes, inertias, joints, friction, servos, torque limits.
Bullet has no rotor inertia at the joints: that of the scene is added to the link's own about the joint's axis. It slows
motions, and has no part in the forces of a grasp at rest. A replay takes ten seconds. Exit code 0 if every one holds.
"""

import contextlib
import importlib.util
import sys
import tempfile
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import trimesh
from tqdm import tqdm

from dexgrasp.cli.command import Argument, Folder, InCell, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.export.read import Recording, read_trajectory
from dexgrasp.export.replay import HEIGHT, HOLD, Replay, displace, load_scene, set_points
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import matrix_to_quat, quat_conjugate, quat_multiply, quat_to_matrix, rotate
from dexgrasp_env.valid import Count, Natural

Pose = tuple[Array, Array]
"""A position (3,), m, and a unit quaternion (4,) wxyz."""
# No drag, no bounce, and convex hulls as they are: Bullet would swell them by a millimetre. NB: with drag or margin
# named, `changeDynamics` sets the base, whatever link it is given.
_EXACT = {"linearDamping": 0.0, "angularDamping": 0.0, "restitution": 0.0, "collisionMargin": 0.0}
_WORLD: Pose = (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
STEP = 0.00025
"""s, of the physics: Bullet takes the torques of the wrist's stiff dampers explicitly. At 0.5 ms they chatter and shake
heavy objects out of the hand."""
_PENETRATION_TIME = 0.02
"""s in which bodies that overlap are pushed apart, as the scene's contacts have it."""
_ITERATIONS = 100


def replay_in_bullet(recording: Recording, scene: Path, rng: np.random.Generator | None = None) -> Replay:
    """Play a trajectory, as `replay` does, in Bullet.

    The servos are the scene's: stiffness, damping, torque limits, weight of the links compensated.

    Args:
        recording: as read.
        scene: `scene.xml` of `export --format mjcf`; the object starts at the keyframe `start`.
        rng: draws the object's error; None leaves the object where it is.

    Raises:
        InputError: if the scene is none, or PyBullet is not installed.
    """
    if importlib.util.find_spec("pybullet") is None:
        raise InputError("replay in Bullet needs pybullet: pip install -c constraints.txt pybullet")
    model, data = load_scene(scene, recording)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    pose = data.qpos[int(model.joint("object").qposadr[0]) :][:7].copy()
    if rng is not None:
        displace(pose, rng)
    with contextlib.closing(World(model, set_points(recording, 0.0), pose)) as world:
        return world.play(recording)


class World:
    """A scene in Bullet; the joints in the order of the model's."""

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
        self.place(start)
        zero = [0.0] * len(start)
        client.setJointMotorControlArray(self.robot, self._joints, client.VELOCITY_CONTROL, forces=zero)
        body = model.body("object").id
        self._inertial = (model.body_ipos[body], model.body_iquat[body])
        position, (w, x, y, z) = compose((pose[:3], pose[3:]), self._inertial)
        client.resetBasePositionAndOrientation(self.object, position.tolist(), [x, y, z, w])

    def close(self) -> None:
        """Give its memory back."""
        self.client.disconnect(self._world)

    def place(self, angles: Array) -> None:
        """Put the robot's joints at angles (23,), rad, at rest."""
        for joint, angle in zip(self._joints, angles.tolist(), strict=True):
            self.client.resetJointState(self.robot, joint, angle)

    def weight(self, angles: Array) -> Array:
        """Joint torques (23,), Nm, that bear the links."""
        zero = [0.0] * len(angles)
        return np.array(self.client.calculateInverseDynamics(self.robot, angles.tolist(), zero, zero))

    def height(self) -> float:
        """Return z of the object's frame, m."""
        position, (x, y, z, w) = self.client.getBasePositionAndOrientation(self.object)
        placed = compose((np.array(position), np.array([w, x, y, z])), inverse(self._inertial))
        return float(placed[0][2])

    def play(self, recording: Recording) -> Replay:
        """Carry a trajectory out, hold, and say what came of it."""
        start, least, time = self.height(), np.inf, 0.0
        end = float(recording.arm.times[-1])
        for step in range(round((end + HOLD) / STEP)):
            time = step * STEP
            self.step(set_points(recording, time))
            if time >= end:
                least = min(least, self.height() - start)
        return Replay(least >= HEIGHT, least)

    def step(self, target: Array) -> None:
        """One step under the scene's servos (23,)."""
        client, model = self.client, self._model
        states = client.getJointStates(self.robot, self._joints)
        angles, speeds = np.array([state[0] for state in states]), np.array([state[1] for state in states])
        servo = model.actuator_gainprm[:, 0] * target + model.actuator_biasprm[:, 1] * angles
        servo += model.actuator_biasprm[:, 2] * speeds
        servo = np.clip(servo, *model.actuator_forcerange.T) + self.weight(angles)
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
    with tempfile.TemporaryDirectory() as folder:
        table = model.body("table").id
        _add_free(client, model, table, Path(folder), fixed=True)
        robot = _add_robot(client, model, table, Path(folder))
        held = _add_free(client, model, model.body("object").id, Path(folder), fixed=False)
    return robot, held


def _add_free(client: Any, model: mujoco.MjModel, body: int, folder: Path, *, fixed: bool) -> int:
    """The table or the object, in its inertial frame. Bullet multiplies frictions: the object has 1, the rest mu."""
    frame = (model.body_ipos[body], model.body_iquat[body])
    shape = _collision_shape(client, model, body, folder, frame)
    place = compose((model.body_pos[body], model.body_quat[body]), frame)
    mass = 0.0 if fixed else float(model.body_mass[body])
    made = client.createMultiBody(
        mass, shape, basePosition=place[0].tolist(), baseOrientation=_xyzw(place[1])
    )
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
        0.0, _collision_shape(client, model, 1, folder, _WORLD),
        basePosition=model.body_pos[1].tolist(), baseOrientation=_xyzw(model.body_quat[1]),
        linkMasses=[float(model.body_mass[b]) for b in links],
        linkCollisionShapeIndices=[_collision_shape(client, model, b, folder, _WORLD) for b in links],
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
    for first, second in _strangers(model, end):
        client.setCollisionFilterPair(robot, robot, first - 2, second - 2, 0)
    return int(robot)


def _friction(model: mujoco.MjModel, body: int) -> float:
    """Sliding coefficient of what collides of a body."""
    colliding = (model.geom_bodyid == body) & (model.geom_contype > 0)
    return float(model.geom_friction[colliding][0, 0])


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


def _strangers(model: mujoco.MjModel, end: int) -> list[tuple[int, int]]:
    """Pairs of the robot's bodies that never touch, as MuJoCo has it: excluded, neighbours, welded together."""
    excluded = {(int(code) >> 16, int(code) & 0xFFFF) for code in model.exclude_signature}
    weld, above = model.body_weldid, model.body_weldid[model.body_parentid[model.body_weldid]]

    def apart(a: int, b: int) -> bool:
        """Return True for two bodies that are not to collide."""
        near = weld[a] and weld[b] and (weld[a] == above[b] or weld[b] == above[a])
        return bool(weld[a] == weld[b] or near or (a, b) in excluded or (b, a) in excluded)

    return [(a, b) for a in range(1, end) for b in range(a + 1, end) if apart(a, b)]


def _collision_shape(client: Any, model: mujoco.MjModel, body: int, folder: Path, frame: Pose) -> int:
    """All that collides of a body as one shape, seen from a frame of the body."""
    geoms = [int(g) for g in np.flatnonzero(model.geom_bodyid == body) if model.geom_contype[g]]
    sizes = model.geom_size
    kinds = {
        mujoco.mjtGeom.mjGEOM_SPHERE: client.GEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE: client.GEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_CYLINDER: client.GEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_BOX: client.GEOM_BOX,
        mujoco.mjtGeom.mjGEOM_MESH: client.GEOM_MESH,
    }  # fmt: skip
    places = [compose(inverse(frame), (model.geom_pos[g], model.geom_quat[g])) for g in geoms]
    return int(
        client.createCollisionShapeArray(
            shapeTypes=[kinds[mujoco.mjtGeom(model.geom_type[g])] for g in geoms],
            radii=[float(sizes[g, 0]) for g in geoms],
            lengths=[2.0 * float(sizes[g, 1]) for g in geoms],
            halfExtents=[sizes[g].tolist() for g in geoms],
            fileNames=[_mesh_file(model, g, folder) for g in geoms],
            meshScales=[[1.0, 1.0, 1.0] for _ in geoms],
            collisionFramePositions=[position.tolist() for position, _ in places],
            collisionFrameOrientations=[_xyzw(quat) for _, quat in places],
        )
    )


def _mesh_file(model: mujoco.MjModel, geom: int, folder: Path) -> str:
    """Write a mesh, of which both simulators take the convex hull; '' for other shapes."""
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
        return ""
    mesh, path = int(model.geom_dataid[geom]), folder / f"{geom}.obj"
    corner, face = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
    corners = model.mesh_vert[corner : corner + model.mesh_vertnum[mesh]]
    faces = model.mesh_face[face : face + model.mesh_facenum[mesh]]
    trimesh.Trimesh(corners, faces, process=False).export(path)
    return str(path)


def _xyzw(quat_wxyz: Array) -> list[float]:
    w, x, y, z = quat_wxyz.tolist()
    return [x, y, z, w]


def compose(a: Pose, b: Pose) -> Pose:
    """Return the pose of b's frame, which is stated in a's."""
    return a[0] + rotate(a[1], b[0]), quat_multiply(a[1], b[1])


def inverse(a: Pose) -> Pose:
    """Return the pose of the outer frame in the inner one."""
    back = quat_conjugate(a[1])
    return -rotate(back, a[0]), back


class Bullet(Script, InCell):
    """Replays, prints how often it held; 1 unless always, 2 for bad input.

    Attributes:
        trajectory: a folder of `dexgrasp export --format mjcf`.
        replay: times.
        seed: of the object's errors: 3 mm and 1 degree.
    """

    trajectory: Argument[Folder]
    replay: Count = 1
    seed: Natural = 0

    def run(self) -> int:
        recording, scene = read_trajectory(self.trajectory, self.cell), self.trajectory / "scene.xml"
        held = [
            replay_in_bullet(recording, scene, np.random.default_rng([self.seed, k])).success
            for k in tqdm(range(self.replay), unit="replay", leave=False)
        ]
        print(
            f"held in {sum(held)} of {len(held)} open-loop replays in Bullet, the object 3 mm and 1 deg off"
        )
        return int(sum(held) < len(held))


if __name__ == "__main__":
    sys.exit(run_script(Bullet))
