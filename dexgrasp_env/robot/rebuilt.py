"""A part of a robot from an MJCF of somebody else's, rebuilt in the conventions that everything here relies on.

Bodies without a joint become one with what they hang on; frames are turned so that an arm's joints turn about z, the
palm's body is the palm frame, and a fingertip's z points out of the tip and x out of its pad. Shapes, masses, ranges,
excluded pairs stay as they are; what collides of a mesh is its convex hull, as in the simulation.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.poses import rigid
from dexgrasp_env.robot.couplings import has_loops, stated_lines
from dexgrasp_env.robot.description import Description, bearers, pose_of
from dexgrasp_env.robot.hulls import colour_of, corners_of, cut, hull_of, mesh_of
from dexgrasp_env.robot.robot import Arm, Finger, Frame, Hand
from dexgrasp_env.robot.source import wrapped_joints

FLANGE = 0.107
"""m from the frame of an arm's last link to its flange, along z: mounts count on it."""
_GEOM = mujoco.mjtGeom
_THIN = 1e-4  # m: slices that are thinner are no body's


def described(part: Arm | Hand) -> mujoco.MjSpec:
    """Return the description of a part: as its file has it, or rebuilt where its frames are stated apart.

    Raises:
        InputError: for a description that MuJoCo cannot read, or that is not of this part.
    """
    if part.frame is not None:
        return _Rebuilt(part).spec
    if not part.mjcf.is_file():
        raise InputError(f"MuJoCo cannot read {part.mjcf}: it is no file")
    try:
        return with_decimal_points(mujoco.MjSpec.from_file, str(part.mjcf))
    except (ValueError, OSError, MemoryError) as error:
        raise InputError(f"MuJoCo cannot read {part.mjcf}: {' '.join(str(error).split())[:200]}") from None


def compiled(part: Arm | Hand) -> mujoco.MjModel:
    """Return the compiled description of a part, without what is only seen.

    Raises:
        InputError: as `described` does.
    """
    return with_decimal_points(solids_of(described(part)).compile)


def solids_of(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Take what is only seen out of a specification, which would cost nine tenths of the compilation; return it."""
    for geom in list(spec.geoms):
        if geom.contype == 0 and geom.conaffinity == 0:
            spec.delete(geom)
    needed = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in needed:
            spec.delete(mesh)
    return spec


class _Rebuilt(Description):
    """A description as it is rebuilt; W are the new frames of bodies in the world of the file, joints at 0."""

    def __init__(self, part: Arm | Hand) -> None:
        super().__init__(part.mjcf)
        self.part, self.hand = part, part if isinstance(part, Hand) else None
        self.held = self.hand.held if self.hand else ()
        self.reach: dict[str, Array] = {}  # points (n, 3) m of solid shapes, in the frame of their body
        self.spec = mujoco.MjSpec()
        self.spec.compiler.degree = False
        self._check()
        self.owner = {b: self._owner(b) for b in range(1, self.model.nbody)}
        self.W = self._frames()
        self._add_bodies()
        self._add_excludes()

    def _check(self) -> None:
        """Refuse a file that is not of the part, or has joints that the part does not name."""
        m = self.model
        own, bodies = set(self.joint_names(range(m.njnt))), {m.body(b).name for b in range(m.nbody)}
        if missing := sorted({*self.part.joints.names} - own) + sorted({*self.part.bodies} - bodies):
            raise InputError(f"{self.path} has no joint or body {missing[0]!r}")
        if more := sorted(own - set(self.part.joints.names + self.held) - self._beyond):
            raise InputError(f"joint {more[0]!r} of {self.path} is not named: every joint has to be")
        pulled = m.actuator_trnid[m.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON, 0]
        tied = self.hand and (self.hand.tendons or self.hand.couplings)
        named = {*self.part.joints.names}
        if any(named & {*self.joint_names(wrapped_joints(m, t)[0])} for t in pulled) and not tied:
            raise InputError(f"{self.path} couples joints by a tendon: that is not supported yet")
        stated = {coupling.joint for coupling in self.hand.couplings} if self.hand else set()
        if has_loops(m) and self.hand and not stated:
            raise InputError(f"{self.path} closes loops of bodies: state their joints under couplings")
        for follower, (leader, *_) in stated_lines(m).items():
            name, other = self.joint_names((follower, leader))
            if not {name, other} & stated and name in self.part.joints.names:
                raise InputError(f"{self.path} couples joint {name!r} to another: state it under couplings")

    @cached_property
    def _beyond(self) -> set[str]:
        """Return the joints of the same file that are no part of this hand, or hang on this arm."""
        m = self.model
        if self.hand:
            palm = m.body(self.hand.palm).id
            joints = [j for j in range(m.njnt) if palm not in bearers(m, m.jnt_bodyid[j])]
        else:
            last = m.body(self.part.bodies[-1]).id
            joints = [j for j in range(m.njnt) if last in bearers(m, m.jnt_bodyid[j])[1:]]
        return set(self.joint_names(joints)) - set(self.part.joints.names + self.held)

    @cached_property
    def _borne(self) -> set[int]:
        """Return the bodies on an arm's last link that bear joints of a hand: its palm, and what is before it."""
        m, last = self.model, self.model.body(self.part.bodies[-1]).id
        above = {b for joint in self._beyond for b in bearers(m, m.joint(joint).bodyid[0])}
        return set() if self.hand else {b for b in above if last in bearers(m, b)[1:]}

    def _owner(self, body: int) -> str:
        """The named body that a body is, or hangs on without a joint; empty for what the part does not begin with."""
        for above in bearers(self.model, body):
            name = self.model.body(above).name
            if name in self.part.bodies:
                return str(name)
            if above in self._borne:
                return ""
            joints = set(self.joint_names(np.flatnonzero(self.model.jnt_bodyid == above)))
            if joints & self._beyond:
                return ""
            if joints - {*self.held}:
                raise InputError(f"body {name!r} of {self.path} is not named")
        return "" if self.hand and self._beyond else self.part.bodies[0]

    def _frames(self) -> dict[str, Array]:
        part, W = self.part, {name: self.pose(name) for name in self.part.bodies}
        assert part.frame is not None
        end = W[part.bodies[-1] if isinstance(part, Arm) else part.palm] @ matrix(part.frame)
        if isinstance(part, Hand):
            W[part.palm] = end
            for name, joint in zip(part.bodies[1:], part.joints.names, strict=True):
                W[name][:3, 3] = self.data.joint(joint).xanchor  # joints sit at their bodies' origins
            for finger in part.fingers:
                assert finger.frame is not None
                T = W[finger.bodies[-1]]
                T[:3, :3] = (T @ matrix(finger.frame))[:3, :3]
            return W
        W[part.bodies[0]] = base_frame(self.data, part.joints.names)
        for name, joint in zip(part.bodies[1:], part.joints.names, strict=True):
            at = self.data.joint(joint)
            W[name] = about(at.xanchor, at.xaxis, W[name][:3, 0])
        axis = W[name][:3, 2] * np.sign(W[name][:3, 2] @ end[:3, 2])
        if axis @ end[:3, 2] < 1.0 - 1e-6:
            raise InputError(
                f"frame of arm {part.name!r}: the flange's z has to be the axis of the last joint"
            )
        W[name] = about(end[:3, 3] - FLANGE * axis, axis, end[:3, 0])
        return W

    def _add_bodies(self) -> None:
        built: Fields = {}
        for name in self.part.bodies:
            above = self.owner[self.model.body(name).parentid[0]] if built else ""
            parent = built[above] if above else self.spec.worldbody
            local = np.linalg.inv(self.W[above]) @ self.W[name] if above else np.eye(4)
            body = parent.add_body(name=name, gravcomp=1.0, **placed(local))
            built[name] = body
            self._add_inertia(body)
            self._add_joint(body)
            self._add_geoms(body)
        if self.hand:
            built[self.hand.palm].add_site(name=self.hand.palm, group=4, size=[0.005] * 3)

    def _add_inertia(self, body: Any) -> None:
        """Give a body the mass and the inertia of all that hangs on it without a joint."""
        own = [b for b, owner in self.owner.items() if owner == body.name]
        mass = self.model.body_mass[own]
        if not mass.sum() > 0:
            return
        centre, box = mass @ self.data.xipos[own] / mass.sum(), self.box_of(own)
        inertia = np.zeros((3, 3))
        if self.is_off(centre, box):
            centre, own = box.mean(0), []
        for b, m in zip(own, mass, strict=False):
            R, away = self.data.ximat[b].reshape(3, 3), self.data.xipos[b] - centre
            inertia += R @ np.diag(self.model.body_inertia[b]) @ R.T
            inertia += m * (away @ away * np.eye(3) - np.outer(away, away))
        if np.linalg.eigvalsh(inertia)[0] <= 0:
            inertia = mass.sum() * 0.02**2 * np.eye(3)  # of a radius of gyration of 2 cm
        W = self.W[body.name]
        R, p = W[:3, :3], W[:3, 3]
        inertia = R.T @ inertia @ R
        total = np.trace(inertia)
        if (
            missing := 2.0 * np.linalg.eigvalsh(inertia)[2] - total
        ) > -1e-9 * total:  # flat, and off to rounding
            inertia += (missing + 1e-6 * total) * np.eye(3)
        body.explicitinertial, body.mass, body.ipos = True, mass.sum(), R.T @ (centre - p)
        body.fullinertia = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]

    def _add_joint(self, body: Any) -> None:
        old = self.model.body(body.name)
        if not old.jntnum[0] or body.name == self.part.bodies[0]:
            return
        joint = self.model.joint(old.jntadr[0])
        W = self.W[body.name]
        R, p = W[:3, :3], W[:3, 3]
        at, dof = self.data.joint(joint.id), joint.dofadr[0]
        named = self.part.joints
        k = named.names.index(joint.name)
        limits = joint.range if joint.limited[0] else named.ranges[:, k]
        slides = joint.type[0] == mujoco.mjtJoint.mjJNT_SLIDE
        # kg m2, kg of slides, where none is stated: joints are geared
        rotor = self.model.dof_armature[dof] or (0.1 if slides or not self.hand else 0.001)
        body.add_joint(
            name=joint.name, type=joint.type[0], axis=np.round(R.T @ at.xaxis, 12),  # so that an axis along z is one
            pos=np.round(R.T @ (at.xanchor - p), 12), range=limits,
            damping=self.model.dof_damping[dof], frictionloss=self.model.dof_frictionloss[dof],
            limited=True, armature=rotor, actgravcomp=True,
        )  # fmt: skip
        servo = self.spec.add_actuator(
            name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT, inheritrange=1.0
        )
        servo.set_to_position(kp=1.0, dampratio=1.0)

    def _add_geoms(self, body: Any) -> None:
        own = [g for g, b in enumerate(self.model.geom_bodyid) if self.owner.get(b) == body.name]
        solid = [g for g in own if self.solid[g]]
        for k, g in enumerate([*solid, *(set(own) - set(solid) or solid)]):
            if not self.is_solid(g):
                raise InputError(f"{self.path}: body {body.name!r} has a shape that is no solid")
            self._add_geom(body, g, f"{body.name}_{k}", k < len(solid))
        for finger in self.hand.fingers if self.hand else ():
            if finger.bodies[-1] == body.name:
                self._add_tip(body, finger)

    def _add_geom(self, body: Any, g: int, name: str, collides: bool) -> None:
        local = np.linalg.inv(self.W[body.name]) @ pose_of(self.data.geom(g))
        look = {"name": name, "rgba": colour_of(self.model, g), **_LOOK[collides]}
        kind, points = _GEOM(self.model.geom_type[g]), corners_of(self.model, g)
        if kind == _GEOM.mjGEOM_MESH:
            points, faces = hull_of(points) if collides else mesh_of(self.model, g)
        points = points @ local[:3, :3].T + local[:3, 3]
        if kind == _GEOM.mjGEOM_MESH:
            points = add_mesh_geom(self.spec, body, points, faces, look)
        else:
            body.add_geom(type=kind, size=self.model.geom_size[g], **placed(local), **look)
        self.reach[name] = points

    def _add_tip(self, body: Any, finger: Finger) -> None:
        """Name the shape that reaches farthest the tip; of a long one, what is before the back of its sphere.

        Of a gripper's jaw, and where several shapes reach beyond the sphere's centre, it is all that is before it.
        """
        assert self.hand is not None and finger.frame is not None
        old = self.pose(body.name) @ matrix(finger.frame)
        centre = np.linalg.inv(self.W[body.name]) @ old[:, 3]
        body.add_site(name=finger.tip, pos=centre[:3], group=4, size=[0.005] * 3)
        solid = [geom for geom in body.geoms if geom.contype]
        if not solid:
            raise InputError(
                f"{self.path}: nothing of body {body.name!r} collides: tip {finger.tip!r} has no shape"
            )
        solid.sort(key=lambda geom: -self.reach[geom.name][:, 2].max())
        tip, radius = solid[0], self.hand.tip_radius
        if self.hand.torsion:  # of a jaw without what ends behind the pad, the way that it approaches
            ends = {geom.name: (self.reach[geom.name] @ [-1.0, 0.0, 1.0]).max() for geom in solid}
            solid = [geom for geom in solid if ends[geom.name] > centre[2] - centre[0] - 1.4 * radius]
        behind = (self.hand.tip_length or 2.0 * radius) - radius
        also = [geom for geom in solid if self.reach[geom.name][:, 2].max() > centre[2]]
        joined = self.hand.torsion or len(also) > 1
        if joined or tip.type in (_GEOM.mjGEOM_MESH, _GEOM.mjGEOM_BOX):
            self._cut_tip(body, finger.tip, solid if joined else [tip], centre[2] - behind)
        else:
            tip.name = finger.tip

    def _cut_tip(self, body: Any, tip: str, solid: list[Any], height: float) -> None:
        """Make one shape of all that is above a height of a body's frame, m, and leave what is below as it is."""
        pieces, look = {tip: [np.zeros((0, 3))]}, {"rgba": solid[0].rgba.copy(), **_LOOK[True]}
        for geom in solid:
            points, name = self.reach[geom.name], geom.name
            if points[:, 2].max() <= height + _THIN:
                continue
            above, below = (
                cut(points, height) if points[:, 2].min() < height - _THIN else (points, points[:0])
            )
            pieces[tip].append(above)
            pieces[f"{name}_rest"] = [below]
            self.spec.delete(geom)
        for name, parts in pieces.items():
            if len(points := np.concatenate(parts)) > 3:
                add_mesh_geom(self.spec, body, *hull_of(points), {"name": name, **look})

    def _add_excludes(self) -> None:
        pairs = [[*map(self.owner.get, divmod(pair, 1 << 16))] for pair in self.model.exclude_signature]
        if not self.hand:  # MuJoCo lets neighbours overlap, but not where one stands in the world
            pairs.append([*self.part.bodies[:2]])
        apart = {tuple(sorted((a, b))) for a, b in pairs if a and b and a != b}
        for k, (a, b) in enumerate(sorted(apart)):
            self.spec.add_exclude(name=f"{self.part.name}_exclude{k}", bodyname1=a, bodyname2=b)
        for a, b in self.hand.excluded if self.hand else ():
            self.spec.add_exclude(name=f"{a}_{b}", bodyname1=a, bodyname2=b)


_LOOK: dict[bool, Fields] = {
    True: {
        "group": 3,
        "contype": 1,
        "conaffinity": 1,
        "condim": 3,
        "friction": [0.7, 0.005, 0.0001],
        "mass": 0.0,
    },
    False: {"group": 2, "contype": 0, "conaffinity": 0, "mass": 0.0},
}
"""Of what collides, and of what is seen."""


def base_frame(data: mujoco.MjData, joints: Sequence[str]) -> Array:
    """Return where an arm stands (4, 4) in the world of its file: turned upright where its first axis lies level."""
    first, last = data.joint(joints[0]), data.joint(joints[-1])
    if abs(first.xaxis[2]) > 0.7:
        return np.eye(4)
    return about(np.zeros(3), first.xaxis * np.sign(first.xaxis @ last.xanchor), np.eye(3)[2])


def add_mesh_geom(spec: mujoco.MjSpec, body: Any, points: Array, faces: Any, look: Fields) -> Array:
    """Add a mesh of points (n, 3) m in the frame of a body, named like its geom; return them as it keeps them."""
    kinds, thick = mujoco.mjtMeshInertia, np.linalg.svd(points - points.mean(0), compute_uv=False)[2]
    mesh = spec.add_mesh(
        name=look["name"],
        uservert=points.ravel(),
        userface=np.asarray(faces).ravel(),
        inertia=kinds.mjMESH_INERTIA_CONVEX
        if thick > 1e-6
        else kinds.mjMESH_INERTIA_SHELL,  # a sheet has no hull
    )
    body.add_geom(type=_GEOM.mjGEOM_MESH, meshname=mesh.name, **look)
    return np.asarray(mesh.uservert, dtype=float).reshape(-1, 3)


def matrix(frame: Frame) -> Array:
    """Return a frame as a transform (4, 4)."""
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, np.array(frame.quat_wxyz))
    return rigid(R.reshape(3, 3), frame.position)


def placed(T: Array) -> dict[str, Array]:
    """Return a transform (4, 4) as position and quaternion, as specifications take them."""
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, T[:3, :3].ravel())
    return {"pos": T[:3, 3].copy(), "quat": quat}


def frame_entry(T_body: Array, T: Array) -> dict[str, list[float]]:
    """Return a frame (4, 4) in that of a body as files state it."""
    found = placed(np.linalg.inv(T_body) @ T)
    return {"position": found["pos"].round(6).tolist(), "quat_wxyz": found["quat"].round(9).tolist()}


def about(origin: Array, z: Array, x: Array) -> Array:
    """Return the frame (4, 4) at `origin` with axis `z`, and x as near to `x` as can be."""
    across = x - z * (x @ z)
    if np.linalg.norm(across) < 1e-3:
        across = np.eye(3)[np.argmin(np.abs(z))]
        across -= z * (across @ z)
    across /= np.linalg.norm(across)
    return rigid(np.stack([across, np.cross(z, across), z], axis=1), origin)
