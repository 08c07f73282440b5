"""A scene of the environments in Drake, whose solver and contacts share no code with MuJoCo's."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import pose_matrix, quat_to_matrix
from dexgrasp_env.robot.model import colliding
from engines.scene import World, mesh_file, pairs_apart

STEP = 0.001
"""s, of the physics; contacts, servos and torque limits are solved implicitly."""
_MODULUS = 1e8
"""Pa, of the hydroelastic contact: patches under a finger's force are some hundredths of a millimetre deep."""
_RESOLUTION = 0.005
"""m, of the meshes that stand for round shapes in contact."""
_DISSIPATION = 10.0
"""s/m, of Hunt and Crossley's model: nothing bounces."""
_NO_SLIP = 1e6
"""Friction of the object: Drake takes 2 mu1 mu2 / (mu1 + mu2), which is then twice that of what it meets."""


class Drake(World):
    """A scene in Drake: the robot under its servos, the object free; the joints in the order of the model's."""

    step_seconds = STEP

    def __init__(self, model: mujoco.MjModel, start: Array, pose: Array) -> None:
        """Set the robot at joint angles (n,), rad, and the object at a pose (7,): position, quaternion wxyz."""
        import pydrake.all as drake

        self._drake, self._model, self._count = drake, model, 0
        builder = drake.DiagramBuilder()
        self._plant, scene = drake.AddMultibodyPlant(
            drake.MultibodyPlantConfig(
                time_step=STEP,
                contact_model="hydroelastic_with_fallback",
                discrete_contact_approximation="lagged",
            ),
            builder,
        )
        self._bodies = [self._plant.world_body()]
        with TemporaryDirectory() as folder:
            for body in range(1, model.nbody):
                self._add_body(body, Path(folder))
            self._plant.mutable_gravity_field().set_gravity_vector(model.opt.gravity)
            self._plant.Finalize()
            self._exclude(scene)
            diagram = builder.Build()
        self._simulator = drake.Simulator(diagram)
        self._context = self._plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        self._robot, self.object = self._bodies[1].model_instance(), self._bodies[-1]
        self._plant.SetPositions(self._context, self._robot, start)
        placed = drake.RigidTransform(drake.Quaternion(pose[3:] / np.linalg.norm(pose[3:])), pose[:3])
        self._plant.SetFreeBodyPose(self._context, self.object, placed)
        self._desired = self._plant.get_desired_state_input_port(self._robot)
        self._simulator.Initialize()

    def step(self, target: Array) -> None:
        """Advance one step under the scene's servos, whose set-points are (n,) rad."""
        self._desired.FixValue(self._context, np.concatenate([target, np.zeros_like(target)]))
        self._count += 1
        self._simulator.AdvanceTo(self._count * STEP)

    def position(self) -> Array:
        """Return the place of the object's frame (3,), m."""
        return np.asarray(self._plant.EvalBodyPoseInWorld(self._context, self.object).translation())

    def joints(self) -> Array:
        """Return the robot's joint angles (n,), rad."""
        return np.asarray(self._plant.GetPositions(self._context, self._robot))

    def _add_body(self, body: int, folder: Path) -> None:
        """Add a body of the model with its joint, servo and shapes."""
        drake, plant, model = self._drake, self._plant, self._model
        name = model.body(body).name
        free, fixed = name == "object", name == "table"
        own = body == 1 or free or fixed
        instance = plant.AddModelInstance(name) if own else self._bodies[1].model_instance()
        added = plant.AddRigidBody(name, instance, self._inertia(body))
        self._bodies.append(added)
        for geom in colliding(model, body):
            self._add_shape(added, geom, folder, free=free)
        if free:
            return
        parent = self._bodies[model.body_parentid[body]]
        place = drake.RigidTransform(pose_matrix(model.body_pos[body], model.body_quat[body]))
        if not model.body_jntnum[body]:
            plant.AddJoint(drake.WeldJoint(f"{name}_weld", parent.body_frame(), added.body_frame(), place))
            return
        k = int(model.body_jntadr[body])
        frame = plant.AddFrame(drake.FixedOffsetFrame(f"{name}_at", parent.body_frame(), place))
        lower, upper = model.jnt_range[k]
        joint = plant.AddJoint(
            drake.RevoluteJoint(
                name, frame, added.body_frame(), model.jnt_axis[k], lower, upper, model.dof_damping[k]
            )
        )
        servo = plant.AddJointActuator(name, joint, float(model.actuator_forcerange[k, 1]))
        servo.set_default_rotor_inertia(float(model.dof_armature[k]))
        servo.set_default_gear_ratio(1.0)
        kp, kd = model.actuator_gainprm[k, 0], -model.actuator_biasprm[k, 2]
        servo.set_controller_gains(drake.PdControllerGains(p=float(kp), d=float(kd)))
        plant.set_gravity_enabled(instance, False)  # the scene's robot compensates its weight

    def _inertia(self, body: int) -> Any:
        """Return the spatial inertia of a body about its frame's origin; nothing's for a base without mass."""
        drake, model = self._drake, self._model
        mass = float(model.body_mass[body])
        if mass == 0.0:
            return drake.SpatialInertia.Zero()
        turned = drake.RotationMatrix(quat_to_matrix(model.body_iquat[body]))
        central = drake.RotationalInertia(*model.body_inertia[body]).ReExpress(turned)
        return drake.SpatialInertia.MakeFromCentralInertia(mass, model.body_ipos[body], central)

    def _add_shape(self, added: Any, geom: int, folder: Path, *, free: bool) -> None:
        """Register one shape that collides."""
        drake, model = self._drake, self._model
        kinds, size = mujoco.mjtGeom, model.geom_size[geom]
        shape = {
            kinds.mjGEOM_SPHERE: lambda: drake.Sphere(size[0]),
            kinds.mjGEOM_CAPSULE: lambda: drake.Capsule(size[0], 2.0 * size[1]),
            kinds.mjGEOM_CYLINDER: lambda: drake.Cylinder(size[0], 2.0 * size[1]),
            kinds.mjGEOM_BOX: lambda: drake.Box(*(2.0 * size)),
            kinds.mjGEOM_MESH: lambda: drake.Convex(mesh_file(model, geom, folder)),
        }[kinds(model.geom_type[geom])]()
        properties = drake.ProximityProperties()
        friction = _NO_SLIP if free else 0.5 * float(model.geom_friction[geom, 0])
        drake.AddContactMaterial(
            dissipation=_DISSIPATION,
            friction=drake.CoulombFriction(friction, friction),
            properties=properties,
        )
        drake.AddCompliantHydroelasticProperties(_RESOLUTION, _MODULUS, properties)
        place = drake.RigidTransform(pose_matrix(model.geom_pos[geom], model.geom_quat[geom]))
        self._plant.RegisterCollisionGeometry(added, place, shape, f"geom{geom}", properties)

    def _exclude(self, scene: Any) -> None:
        """Exclude contacts of the pairs of bodies that pass through each other in the model."""
        drake, manager = self._drake, scene.collision_filter_manager()
        for a, b in pairs_apart(self._model, self._model.body("table").id):
            sets = [
                drake.GeometrySet(self._plant.GetCollisionGeometriesForBody(self._bodies[k])) for k in (a, b)
            ]
            manager.Apply(drake.CollisionFilterDeclaration().ExcludeBetween(*sets))
