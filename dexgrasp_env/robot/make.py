"""A robot file made of somebody else's MJCF: what can be derived is, and what cannot is assumed and said."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_atomically
from dexgrasp_env.robot.foreign import FLANGE, about, compile_file, described, placed
from dexgrasp_env.robot.hulls import cut
from dexgrasp_env.robot.postures import home_posture, open_posture
from dexgrasp_env.robot.robot_file import SCHEMA, find_beside, make_arm, make_hand

_STIFFNESS, _TORQUE = 10.0, 0.7  # Nm/rad, Nm
_LOAD = 20.0  # N, of a hand and what it holds
_LARGEST_LAG = 0.2  # rad that a set-point which presses in full may be ahead
_FILES = (".yaml", ".yml")
_BEHIND = 0.0133  # m between flange and the palm's back: a plate
_PALM_DOWN = (0.0, 0.5**0.5, 0.0, 0.5**0.5)  # x of the palm along the flange, its z along the last link's x


@dataclass
class Part:
    """A description as it is looked at, all joints at 0 or as near as they go.

    Attributes:
        path: of the MJCF.
        model, data: of it.
        notes: what was assumed, a line each.
    """

    path: Path
    model: mujoco.MjModel = field(init=False)
    data: mujoco.MjData = field(init=False)
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Compile it."""
        self.model = compile_file(self.path)
        self.data = mujoco.MjData(self.model)
        if self.model.njnt == 0:
            raise InputError(f"{self.path} has no joints: it is no hand and no arm")
        self.data.qpos[:] = 0.0
        if self.model.nq == self.model.njnt:
            self.data.qpos[:] = np.clip(0.0, *self.ranges(range(self.model.njnt)).T)
        mujoco.mj_kinematics(self.model, self.data)

    def ranges(self, joints: Any) -> Array:
        """Return the ranges (n, 2) rad of joints; a whole turn where there is none."""
        limited = self.model.jnt_limited[list(joints)].astype(bool)[:, None]
        turn = np.array([-np.pi, np.pi])
        return np.where(limited, self.model.jnt_range[list(joints)], turn)

    def pose(self, body: int) -> Array:
        """Return the pose (4, 4) of a body."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.data.xmat[body].reshape(3, 3), self.data.xpos[body]
        return T

    def below(self, body: int) -> list[int]:
        """Return the bodies that hang on a body and have or lead to joints."""
        children = [
            b for b in range(1, self.model.nbody) if self.model.body_parentid[b] == body and b != body
        ]
        return [b for b in children if self.model.body_jntnum[b] or self.below(b)]

    def chain(self, body: int) -> list[int]:
        """Return the jointed bodies from a body to the end of its chain.

        Raises:
            InputError: if it branches, or a body has several joints.
        """
        found = []
        while True:
            if self.model.body_jntnum[body] > 1:
                raise InputError(
                    f"body {self._name(body)} has {self.model.body_jntnum[body]} joints: valid is one"
                )
            found += [body] if self.model.body_jntnum[body] else []
            following = self.below(body)
            if not following:
                return found
            if len(following) > 1:
                raise InputError(
                    f"the chain of bodies branches at {self._name(body)}: a finger and an arm are one each"
                )
            body = following[0]

    def _name(self, body: int) -> str:
        return repr(self.model.body(body).name)

    def names(self, bodies: list[int]) -> tuple[list[str], list[str]]:
        """Return names of bodies and of their joints."""
        joints = [self.model.joint(int(self.model.body_jntadr[b])).name for b in bodies]
        own = [self.model.body(b).name for b in bodies]
        if "" in joints + own:
            raise InputError(f"{self.path}: a body or a joint has no name: give each one")
        return own, joints

    def points(self, body: int) -> Array:
        """Return points (n, 3) m around what collides of a body and of what it bears, in the world of the file.

        Raises:
            InputError: where nothing does.
        """
        m, corners = self.model, np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T
        found = []
        for g in np.flatnonzero(m.geom_contype | m.geom_conaffinity):
            if not self.hangs_on(int(m.geom_bodyid[g]), body):
                continue
            if m.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH:
                k = int(m.geom_dataid[g])
                local = m.mesh_vert[m.mesh_vertadr[k] : m.mesh_vertadr[k] + m.mesh_vertnum[k]]
            else:
                local = m.geom_aabb[g, :3] + m.geom_aabb[g, 3:] * corners
            found.append(local @ self.data.geom_xmat[g].reshape(3, 3).T + self.data.geom_xpos[g])
        if not found:
            raise InputError(f"nothing of body {self._name(body)} collides: give it a collision geom")
        return np.concatenate(found)

    def hangs_on(self, body: int, other: int) -> bool:
        """Whether a body is another, or hangs on it without a joint."""
        while body != other and body and not self.model.body_jntnum[body]:
            body = int(self.model.body_parentid[body])
        return body == other

    def limits(self, joints: list[str], kind: str) -> dict[str, Any]:
        """Return the limits and gains of joints as files state them; what the MJCF does not say is noted."""
        m, numbers = self.model, [self.model.joint(name).id for name in joints]
        of = {int(m.actuator_trnid[a, 0]): a for a in range(m.nu) if m.actuator_trntype[a] == 0}
        stated = [self._torque(j, of.get(j)) for j in numbers]
        assumed = _ASSUMED[kind]
        missing = _TORQUE if kind == "hand" else self._bearing()
        if None in stated:
            self.notes.append(f"{kind} torque: none in {self.path.name}, {missing} Nm assumed")
        torque = [missing if most is None else most for most in stated]
        gains = [float(m.actuator_gainprm[of[j], 0]) if j in of else 0.0 for j in numbers]
        if (
            min(gains) <= 0
            or (kind == "hand" and max(np.divide(torque, gains)) > _LARGEST_LAG)
            or (kind == "hand" and len(set(gains)) > 1)
        ):
            self.notes.append(f"{kind} stiffness: {assumed['stiffness']} Nm/rad assumed")
            gains = [assumed["stiffness"]] * len(numbers)
        rates = {key: assumed[key] for key in ("velocity", "acceleration", "jerk")}
        self.notes.append(f"{kind} velocity, acceleration, jerk: an MJCF has none, {rates} assumed")
        low, high = np.round(self.ranges(numbers), 6).T.tolist()
        stiffness = gains[0] if kind == "hand" else gains
        return {"lower": low, "upper": high, **rates, "torque": torque, "stiffness": stiffness}

    def _bearing(self) -> float:
        """The torque Nm with which any joint bears twice what hangs on it and a load at the end, in any posture."""
        m, data, most = self.model, mujoco.MjData(self.model), 0.0
        end, J = m.nbody - 1, np.zeros((3, m.nv))
        low, high = self.ranges(range(m.njnt)).T
        for q in np.random.default_rng(0).uniform(low, high, (500, m.njnt)):
            data.qpos[:] = q
            mujoco.mj_forward(m, data)
            mujoco.mj_jacBody(m, data, J, None, end)
            most = max(most, float(np.abs(data.qfrc_bias - data.qfrc_gravcomp + _LOAD * J[2]).max()))
        return float(np.ceil(2.0 * most))

    def _torque(self, joint: int, actuator: int | None) -> float | None:
        m = self.model
        found = [m.jnt_actfrcrange[joint, 1]] if m.jnt_actfrclimited[joint] else []
        if actuator is not None and m.actuator_forcelimited[actuator]:
            found.append(m.actuator_forcerange[actuator, 1])
        return float(min(found)) if found and min(found) > 0 else None


_ASSUMED = {
    "hand": {"stiffness": _STIFFNESS, "velocity": 7.0, "acceleration": 60.0, "jerk": 3000.0},
    "arm": {"stiffness": 2000.0, "velocity": 2.0, "acceleration": 8.0, "jerk": 4000.0},
}


def frame_entry(T_body: Array, T: Array) -> dict[str, list[float]]:
    """Return a frame (4, 4) in that of a body as files state it."""
    found = placed(np.linalg.inv(T_body) @ T)
    return {"position": np.round(found["pos"], 6).tolist(), "quat_wxyz": np.round(found["quat"], 9).tolist()}


class HandMaker:
    """Finds palm, fingers, tips of a hand's description."""

    def __init__(self, path: Path) -> None:
        """Look at it.

        Raises:
            InputError: for what is no hand of hinges with three fingers or more.
        """
        self.part = part = Part(path)
        m = part.model
        if m.neq or m.ntendon:
            raise InputError(f"{path} couples joints (equality, tendon): such hands are not supported yet")
        if (m.jnt_type != mujoco.mjtJoint.mjJNT_HINGE).any():
            raise InputError(
                f"{path} has joints that are no hinges: valid is a hand of hinges that does not float"
            )
        self.palm = self._find_palm()
        self.chains = [part.chain(b) for b in part.below(self.palm)]
        if len(self.chains) < 3:
            raise InputError(f"{path} has {len(self.chains)} fingers: valid are three or more")
        self._tips = [self._tip(chain) for chain in self.chains]
        self.thumb = self._find_thumb()
        self.frame = self._palm_frame()
        self.radius = float(np.round(min(radius for _, radius in self._tips), 4))

    def _find_palm(self) -> int:
        body = 0
        while len(self.part.below(body)) == 1:
            body = self.part.below(body)[0]
            if self.part.model.body_jntnum[body]:
                raise InputError(f"{self.part.path} has joints before its palm branches: take the wrist out")
        return body

    def _tip(self, chain: list[int]) -> tuple[Array, float]:
        """Frame (4, 4) at the end of a chain, its origin on the surface of the pad, and the radius m of its tip."""
        m, data = self.part.model, self.part.data
        j = int(m.body_jntadr[chain[-1]])
        axis, anchor = data.xaxis[j], data.xanchor[j]
        low, high = self.part.ranges([j])[0]
        flexing = axis if high > -low else -axis
        points, radius = self.part.points(chain[-1]) - anchor, 0.01
        along = points - np.outer(points @ axis, axis)
        way = along[np.argmax(np.linalg.norm(along, axis=1))]
        for _ in range(10):  # the section at the sphere's middle says where the tip is, and how wide
            T = about(anchor, way / np.linalg.norm(way), np.cross(flexing, way))
            local = points @ T[:3, :3]
            top = local[:, 2].max()
            section = self._section(local, top - radius)
            radius = float(np.clip(0.5 * np.ptp(section, axis=0).min(), 0.005, 0.02))
            middle = 0.5 * (section.min(0) + section.max(0))
            way = T[:3, :3] @ [middle[0], 0.0, top - radius]
        T[:3, 3] += T[:3, :3] @ [section[:, 0].max(), middle[1], top]
        return T, radius

    @staticmethod
    def _section(points: Array, height: float) -> Array:
        above, _ = cut(points, height)
        return above[np.abs(above[:, 2] - height) < 1e-9][:, :2]

    def tip(self, k: int) -> Array:
        """Return the frame (4, 4) of a finger's tip, its origin at the middle of the sphere."""
        T = self._tips[k][0].copy()
        T[:3, 3] -= self.radius * (T[:3, 0] + T[:3, 2])
        return T

    def _find_thumb(self) -> int:
        """The finger that points and faces least as the others do."""
        ways = np.array([np.r_[T[:3, 2], T[:3, 0]] for T, _ in self._tips])
        return int(np.argmin((ways @ ways.T).sum(1)))

    def _others(self) -> list[int]:
        return [k for k in range(len(self.chains)) if k != self.thumb]

    def _palm_frame(self) -> Array:
        others = [self._tips[k][0] for k in self._others()]
        z = np.mean([T[:3, 2] for T in others], axis=0)
        T = about(np.zeros(3), z / np.linalg.norm(z), np.mean([T[:3, 0] for T in others], axis=0))
        m, data = self.part.model, self.part.data
        bases = np.array([data.xanchor[int(m.body_jntadr[self.chains[k][0]])] for k in self._others()])
        depth = np.mean(
            [
                (t[:3, 3] - self._tips[k][1] * t[:3, 0]) @ T[:3, 0]
                for k, t in zip(self._others(), others, strict=True)
            ]
        )
        base = bases.mean(0)
        T[:3, 3] = base + (depth - base @ T[:3, 0]) * T[:3, 0]
        return T

    def entry(self) -> dict[str, Any]:
        """Return what the hand's file says."""
        part, m = self.part, self.part.model
        order = [*self._others(), self.thumb]
        base = {k: part.data.xanchor[int(m.body_jntadr[self.chains[k][0]])] for k in order}
        near = sorted(self._others(), key=lambda k: float(np.linalg.norm(base[k] - base[self.thumb])))[:2]
        names = {k: f"finger_{i + 1}" for i, k in enumerate(self._others())} | {self.thumb: "thumb"}
        fingers, joints = [], list[str]()
        for k in order:
            bodies, own = part.names(self.chains[k])
            joints += own
            entry: dict[str, Any] = {
                "name": names[k],
                "joints": own,
                "bodies": bodies,
                "tip": f"{names[k]}_tip",
            }
            entry["frame"] = frame_entry(part.pose(self.chains[k][-1]), self.tip(k))
            if k not in (*near, self.thumb):
                entry["aside"] = (
                    np.clip(0.0, *part.ranges([m.joint(name).id for name in own]).T).round(6).tolist()
                )
            fingers.append(entry)
        palm = m.body(self.palm).name
        return {
            "name": m.names.split(b"\0")[0].decode() or part.path.stem, "mjcf": str(part.path.resolve()), "palm": palm,
            "frame": frame_entry(part.pose(self.palm), self.frame), "tip_radius": self.radius,
            **part.limits(joints, "hand"),
            "fingers": fingers, "grasp": ["thumb", *(names[k] for k in near)],
            "mounts": {"palm_normal": self._mount()},
        }  # fmt: skip

    def _mount(self) -> dict[str, list[float]]:
        """The back of the hand on the flange, the palm's middle on the flange's axis."""
        palm, *fingers = (
            (self.part.points(b) - self.frame[:3, 3]) @ self.frame[:3, :3]
            for b in (self.palm, *(chain[0] for chain in self.chains))
        )
        middle = 0.5 * (palm.min(0) + palm.max(0))
        back = min(points[:, 0].min() for points in (palm, *fingers))
        position = [-middle[2], middle[1], FLANGE + _BEHIND - back]
        return {"position": np.round(position, 6).tolist(), "quat_wxyz": list(_PALM_DOWN)}


def hand_entry(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Return what a hand's file says of an MJCF, and what was assumed.

    Raises:
        InputError: for what is no hand of hinges with three fingers or more.
    """
    maker = HandMaker(path)
    entry = maker.entry()
    value = make_hand({**entry, "open": np.clip(0.0, entry["lower"], entry["upper"]).tolist()})
    return entry | {"open": open_posture(value, described(value).compile())}, maker.part.notes


def arm_entry(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Return what an arm's file says of an MJCF, and what was assumed.

    Raises:
        InputError: for what is no chain of hinges.
    """
    part = Part(path)
    m, data = part.model, part.data
    root = part.below(0)
    if len(root) != 1:
        raise InputError(f"{path} has {len(root)} chains of bodies: valid is one arm, without a hand")
    chain = part.chain(root[0])
    bodies, joints = part.names(chain)
    base = root[0] if root[0] not in chain else 0
    if not base:
        raise InputError(
            f"{path}: the first body turns: valid is a base that stands still, and the arm on it"
        )
    sites = [s for s in range(m.nsite) if part.hangs_on(int(m.site_bodyid[s]), chain[-1])]
    flange = part.pose(chain[-1])
    if sites:
        flange[:3, :3], flange[:3, 3] = data.site_xmat[sites[-1]].reshape(3, 3), data.site_xpos[sites[-1]]
    else:
        part.notes.append("arm frame: no site at the flange, the last body's frame assumed")
    second = data.xanchor[m.joint(joints[1]).id]
    entry: dict[str, Any] = {
        "name": m.names.split(b"\0")[0].decode() or path.stem, "mjcf": str(path.resolve()),
        "bodies": [m.body(base).name, *bodies], "joints": joints, "frame": frame_entry(part.pose(chain[-1]), flange),
        **part.limits(joints, "arm"), "shoulder": np.round([0.0, 0.0, second[2]], 4).tolist(),
        "reach": round(_reach(part, flange, chain[-1], second), 3), "shaken": [0, (len(joints) - 1) // 2],
    }  # fmt: skip
    value = make_arm({**entry, "home": np.clip(0.0, entry["lower"], entry["upper"]).tolist()})
    home, found = home_posture(value, described(value).compile())
    if not found:
        part.notes.append(
            "arm home: none looks down on the table; state one, and look at the flange's frame and the ranges"
        )
    return entry | {"home": home}, part.notes


def _reach(part: Part, flange: Array, last: int, shoulder: Array) -> float:
    """How far the flange gets from the shoulder in random postures, m."""
    local = np.linalg.inv(part.pose(last)) @ flange[:, 3]
    low, high = part.ranges(range(part.model.njnt)).T
    farthest = 0.0
    for q in np.random.default_rng(0).uniform(low, high, (4000, len(low))):
        part.data.qpos[:] = q
        mujoco.mj_kinematics(part.model, part.data)
        farthest = max(farthest, float(np.linalg.norm((part.pose(last) @ local)[:3] - shoulder)))
    return farthest


def make_robot(hand: Path | None, arm: Path | None, out: Path) -> list[str]:
    """Write a robot's file, and beside it its hand's and its arm's where they are given as MJCF.

    Args:
        hand: its MJCF, or a hand's file; None for our Allegro.
        arm: its MJCF, or an arm's file; None for our Panda.
        out: the robot's file to be.

    Returns:
        What was assumed, a line each.

    Raises:
        InputError: for a description that no file can be made of.
    """
    files, notes = dict[str, dict[str, Any]](), list[str]()
    robot = {"name": out.stem, "arm": "panda.yaml", "hand": "allegro.yaml"}
    for kind, path, entry_of in (("hand", hand, hand_entry), ("arm", arm, arm_entry)):
        if path is not None and path.suffix in _FILES:
            robot[kind] = str(find_beside(Path(), str(path)).resolve())
        elif path is not None:
            files[kind], said = entry_of(path)
            robot[kind], notes = f"{out.stem}_{kind}.yaml", notes + said
    files["robot"] = robot | {"mount": "palm_normal"}
    for kind, content in files.items():
        name = out.name if kind == "robot" else f"{out.stem}_{kind}.yaml"
        text = yaml.safe_dump(
            {"schema": SCHEMA, "kind": kind, **content}, sort_keys=False, default_flow_style=None, width=110
        )
        write_atomically(out.parent / name, text.encode())
    return notes
