"""An exported trajectory carried out in Bullet (PyBullet), whose contacts share no code with MuJoCo's."""

import contextlib
import functools
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dexgrasp.export.bullet_bodies import add_bodies, compose, inverse
from dexgrasp.export.read import Recording
from dexgrasp.export.replay import HEIGHT, HOLD, Replay, displace, load_scene, set_points
from dexgrasp_env.arrays import Array
from dexgrasp_env.extras import require_extra

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
    require_extra("bullet", "replay in Bullet")
    model, data = load_scene(scene)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    pose = data.qpos[int(model.joint("object").qposadr[0]) :][:7].copy()
    if rng is not None:
        displace(pose, rng)
    with contextlib.closing(World(model, set_points(recording, 0.0), pose)) as world:
        return world.play(recording)


class Client:
    """PyBullet's functions and constants, for one world of its own (its `BulletClient` prints to stdout)."""

    def __init__(self) -> None:
        import pybullet

        self._module, self._world = pybullet, pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        member = getattr(self._module, name)
        return functools.partial(member, physicsClientId=self._world) if callable(member) else member


class World:
    """A scene in Bullet; the joints in the order of the model's."""

    def __init__(self, model: mujoco.MjModel, start: Array, pose: Array) -> None:
        """Set the robot at joint angles (23,), rad, and the object at a pose (7,): position, quaternion wxyz."""
        self.client = client = Client()
        self._model = model
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
        self.client.disconnect()

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
