"""A description in MJCF as `make` looks at it: chains of bodies, shapes, and what it states of its joints."""

from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from dexgrasp_env.arrays import Array, Fields, Index, middle
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.couplings import DRIVES_JOINT
from dexgrasp_env.robot.description import Description
from dexgrasp_env.robot.robot import SLIDE, STRONGEST, Coupling
from dexgrasp_env.robot.source import below, wrapped_joints

_RATES = {
    "hand": {"velocity": 7.0, "acceleration": 60.0, "jerk": 3000.0},
    "gripper": {"velocity": 1.0, "acceleration": 20.0, "jerk": 1000.0},
    "arm": {"velocity": 2.0, "acceleration": 8.0, "jerk": 4000.0},
}


class NamedParts(NamedTuple):
    """Parts of a hand that its user names, where guesses are wrong."""

    palm: str | None = None
    """Body that bears the fingers."""
    thumb: str | None = None
    """A body of the opposing finger."""
    flip: tuple[str, ...] = ()
    """Last bodies of fingers whose pads are on the other side."""


class Part(Description):
    """A description as it is looked at, all joints at 0 or as near as they go; `notes` say what was assumed."""

    def __init__(self, path: Path) -> None:
        """Compile it.

        Raises:
            InputError: for what MuJoCo cannot read, has no joints, or others than hinges and slides.
        """
        super().__init__(path)
        self.notes = list(self.source.notes)
        self.couplings = list[Coupling]()
        self.still = list[int]()  # bodies whose joints are held
        if self.model.njnt == 0:
            raise InputError(f"{path} has no joints: it is no hand and no arm")
        self.place(np.clip(0.0, *self.ranges().T))
        heavy = np.flatnonzero(self.model.body_mass > 0).tolist()
        if off := [self._name(b) for b in heavy if self.is_off(self.data.xipos[b], self.box_of([b]))]:
            self.notes.append(
                f"centres of mass far off the shapes of {', '.join(off)}: their middles are taken"
            )

    def place(self, q: Array) -> None:
        """Put the joints at `q` (n,) rad or m."""
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)

    def head(self) -> dict[str, str]:
        """Return name and path as files state them."""
        name = self.model.names.split(b"\0")[0].decode()
        return {
            "name": name if name not in ("", "MuJoCo Model") else self.path.stem,
            "mjcf": str(self.path.resolve()),
        }

    def ranges(self, joints: Any = slice(None)) -> Array:
        """Return the ranges (n, 2) rad or m of joints, by default all; a whole turn where there is none."""
        limited = self.model.jnt_limited[joints].astype(bool)[:, None]
        return np.where(limited, self.model.jnt_range[joints], np.outer(self.units(joints), [-np.pi, np.pi]))

    def units(self, joints: Any = slice(None)) -> Array:
        """Return what counts as much as a radian of joints (n,): 1, or `SLIDE` m."""
        return np.where(self.model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_SLIDE, SLIDE, 1.0)

    def below(self, body: int) -> list[int]:
        """Return the bodies that hang on a body and have or lead to joints."""
        return below(self.model, body)

    def solids(self, body: int) -> list[int]:
        """Return the geoms that collide of a body and of what it bears without a joint."""
        solid = np.flatnonzero(self.solid).tolist()
        return [g for g in solid if self.hangs_on(self.model.geom_bodyid[g], body)]

    def chain(self, body: int) -> list[int]:
        """Return the jointed bodies from a body to the end of its chain, or to the first where it branches.

        Raises:
            InputError: if it branches before the first joint.
        """
        found = []
        while True:
            found += [body] if self.model.body_jntnum[body] else []
            following = self.below(body)
            if not following or (len(following) > 1 and found):
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
        joints = self.joint_names(self.model.body_jntadr[bodies])
        own = [self.model.body(b).name for b in bodies]
        if "" in joints + own:
            raise InputError(f"{self.path}: a body or a joint has no name: give each one")
        return own, joints

    def points(self, body: int) -> Array:
        """Return points (n, 3) m around what collides of a body and of what it bears, in the world of the file.

        Raises:
            InputError: where nothing does.
        """
        return np.concatenate(self.shapes(body))

    def outline(self, body: int) -> Array:
        """Return what `points` does, or where a body is (1, 3) m that nothing of collides."""
        return self.points(body) if self.solids(body) else self.data.xpos[[body]]

    def shapes(self, body: int) -> list[Array]:
        """Return the points (n, 3) m of each shape that `points` returns together."""
        found = [self.shape_points(g) for g in self.solids(body)]
        if not found:
            raise InputError(f"nothing of body {self._name(body)} collides: give it a collision geom")
        return found

    def bending(self, chain: list[int]) -> tuple[Index, Array]:
        """Return the joints of a finger that turn about the axis of its last one, and the sense of each."""
        joints = self.model.body_jntadr[chain]
        along = self.data.xaxis[joints] @ self.data.xaxis[joints[-1]]
        return joints[np.abs(along) > 0.8], np.sign(along[np.abs(along) > 0.8])

    def open_drawn(self, fingers: list[list[int]]) -> None:
        """Open fingers that the file draws closed: their ends are near each other, and part the farther they turn."""
        low, high = self.ranges().T
        bending = np.concatenate([self.bending(chain)[0] for chain in fingers])
        drawn, far, ends = self.data.qpos.copy(), self.data.qpos.copy(), []
        far[bending] = np.where(drawn - low > high - drawn, low, high)[bending]
        for q in (far, drawn):
            self.place(q)
            ends.append(np.array([middle(self.points(chain[-1])) for chain in fingers]))
        apart = ends[1] - ends[1].mean(0)
        near = np.linalg.norm(apart, axis=1).max() < 0.03  # m
        if near and ((ends[0] - ends[1]) * apart).sum() > 0.5 * (apart**2).sum():
            self.place(far)
            self.notes.append("hand: its fingers are drawn closed: they open as far as their joints go")

    def straighten(self, fingers: list[list[int]]) -> None:
        """Stretch fingers that the file draws bent, as far as their joints go."""
        straight = self.data.qpos.copy()
        for chain in fingers:
            joints, senses = self.bending(chain)
            axis, anchors = self.data.xaxis[joints[-1]], self.data.xanchor[joints]
            ways = anchors[-1] - anchors[0], middle(self.points(chain[-1])) - anchors[-1]
            link, end = np.cross(ways, axis)
            bent = float(np.arctan2(np.cross(link, end) @ axis, link @ end))
            if abs(bent) > 0.5:  # rad
                for joint, sense in zip(joints[::-1], senses[::-1], strict=True):
                    low_high = self.ranges([joint])[0]
                    if bent * sense * low_high.sum() > 0.0:  # it bends to the side on which it goes farther
                        straight[joint] = np.clip(-bent * sense, *low_high)
                        bent += sense * straight[joint]
        self.place(straight)

    def hangs_on(self, body: int, other: int) -> bool:
        """Return True where a body is another, or hangs on it without a joint."""
        while body != other and body and (not self.model.body_jntnum[body] or body in self.still):
            body = self.model.body_parentid[body]
        return body == other

    def limits(self, joints: list[str], kind: str) -> Fields:
        """Return the limits and gains of joints as files state them; what the MJCF does not say is noted.

        Args:
            joints: names.
            kind: hand, gripper or arm. Of a gripper's joints without servos the torque is 0.
        """
        numbers = self.joint_ids(joints)
        units = self.units(numbers)
        widths = (np.ptp(self.ranges(numbers), axis=1) / units)[units == 1.0]
        if len(widths) and not 0.05 < np.median(widths) < 8.0 * np.pi:  # rad
            raise InputError(
                f"{self.path}: its joints range over {np.median(widths):.3g} rad: URDF states radians, MJCF degrees"
                ' unless its <compiler> has angle="radian"'
            )
        stated = [self._torque(j, self.servos.get(j)) for j in numbers]
        missing = self._bearing() if kind == "arm" else {"hand": 0.7, "gripper": 4.0}[kind]
        passive = kind == "gripper" and any(stated)
        if None in stated and not passive:
            self.notes.append(f"{kind} torque: none in {self.path.name}, {missing} Nm assumed")
        assumed = ((0.0 if passive else missing) / units).tolist()
        torque = [most or own for most, own in zip(stated, assumed, strict=True)]
        torque = self._bounded(torque, units, kind)
        gains = self._gains(numbers, torque, kind)
        rates, stated_rates = dict[str, Any](_RATES[kind]), self.source.velocity
        if (units < 1.0).any():
            rates = {key: (rate * units).tolist() for key, rate in rates.items()}
        if all(name in stated_rates for name in joints):
            rates["velocity"] = [stated_rates[name] for name in joints]
        missing_rates = ", ".join(
            f"{key} {value}" for key, value in rates.items() if not isinstance(value, list)
        )
        if missing_rates:
            self.notes.append(f"{kind}: {self.path.name} states none, {missing_rates} assumed")
        if endless := self.joint_names(j for j in numbers if kind != "arm" and not self.model.jnt_limited[j]):
            self.notes.append(f"{kind} ranges: {', '.join(endless)} have none, a whole turn is assumed")
        low, high = self.ranges(numbers).round(6).T.tolist()
        stiffness = gains if kind == "arm" else gains[0]
        return {"lower": low, "upper": high, **rates, "torque": torque, "stiffness": stiffness}

    def _bounded(self, torque: list[float], units: Array, kind: str) -> list[float]:
        """Return torques of joints, those of jaws no larger than fingers have; say so of placeholders."""
        most = float(max(torque * units))
        if kind == "arm" or most <= STRONGEST:
            return torque
        self.notes.append(f"{kind} torque: {most:g} Nm is stated, more than fingers have: put in the maker's")
        if kind == "hand":
            return torque
        self.notes.append(f"{kind} torque: {STRONGEST:g} Nm are taken, of slides {STRONGEST / SLIDE:g} N")
        return list(np.minimum(torque, STRONGEST / units).tolist())

    def _gains(self, numbers: list[int], torque: list[float], kind: str) -> list[float]:
        """Return stiffnesses Nm/rad or N/m of joints: those stated, where they are of use here."""
        gains = [self._stiffness(*self.servos[j]) if j in self.servos else 0.0 for j in numbers]
        if kind == "gripper":  # set-points that press in full are 0.1 rad ahead
            return [float(max(np.divide(torque, self.units(numbers)))) / 0.1] * len(numbers)
        if min(gains) > 0 and kind == "arm":
            return gains
        if min(gains) > 0 and max(np.divide(torque, gains)) <= 0.2 and len(set(gains)) == 1:
            return gains
        # Set-points that press in full are 0.2 rad ahead of a finger at most.
        assumed = 2000.0 if kind == "arm" else max(10.0, min(max(torque), STRONGEST) / 0.2)
        self.notes.append(f"{kind} stiffness: {assumed} Nm/rad assumed")
        return [assumed] * len(numbers)

    def tendons(self) -> dict[int, dict[int, float]]:
        """Return, of each actuator that pulls a tendon, joints and coefficients from the palm out.

        Raises:
            InputError: for tendons with a servo that are no sums of joints.
        """
        m, found = self.model, dict[int, dict[int, float]]()
        pulled = m.actuator_trnid[m.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON, 0]
        for a in np.flatnonzero(m.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON).tolist():
            joints, coefs = wrapped_joints(m, m.actuator_trnid[a, 0])
            if not joints or self._is_one_drive(joints):
                continue  # over pulleys, or the servo of joints that are coupled anyway
            if max(coefs) < 0:
                coefs = [-coef for coef in coefs]  # pulled the other way
            if min(coefs) <= 0:
                name = m.tendon(m.actuator_trnid[a, 0]).name
                raise InputError(f"{self.path}: tendon {name!r} is no sum of joints times positive coefs")
            found[a] = dict(sorted(zip(joints, coefs, strict=True)))
        own = [wrapped_joints(m, t)[0] for t in range(m.ntendon)]
        if others := [
            t for t, j in enumerate(own) if not j or (t not in pulled and not self._is_one_drive(j))
        ]:
            self.notes.append(
                f"hand: {len(others)} tendons over pulleys or without servos are left out; each joint has a servo"
            )
        return found

    def _bearing(self) -> float:
        """The torque Nm with which any joint bears twice what hangs on it and 20 N at the end, in any posture."""
        m, data, most = self.model, mujoco.MjData(self.model), 0.0
        end, J = m.nbody - 1, np.zeros((3, m.nv))
        low, high = self.ranges().T
        for q in np.random.default_rng(0).uniform(low, high, (500, m.njnt)):
            data.qpos[:] = q
            mujoco.mj_forward(m, data)
            mujoco.mj_jacBody(m, data, J, None, end)
            most = max(most, np.abs(data.qfrc_bias - data.qfrc_gravcomp + 20.0 * J[2]).max())
        return float(np.ceil(2.0 * most))

    @cached_property
    def servos(self) -> dict[int, tuple[int, float]]:
        """Of each joint, the actuator that drives it and its lever: N or Nm of the joint for one of its own.

        Of several at one joint it is the stiffest: the others damp, or push besides.
        """
        m, found = self.model, dict[int, tuple[int, float]]()
        for a in np.flatnonzero(np.isin(m.actuator_trntype, DRIVES_JOINT)).tolist():
            joint, lever = int(m.actuator_trnid[a, 0]), abs(float(m.actuator_gear[a, 0]))
            if joint not in found or self._stiffness(a, lever) > self._stiffness(*found[joint]):
                found[joint] = a, lever
        tendons = self.tendons()
        for a in np.flatnonzero(m.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON).tolist():
            joints, coefs = wrapped_joints(m, m.actuator_trnid[a, 0])
            gear = abs(float(m.actuator_gear[a, 0]))
            if a in tendons:
                found |= dict.fromkeys(joints, (a, gear * max(map(abs, coefs))))
            elif self._is_one_drive(joints):
                found |= {joint: (a, gear * abs(coef)) for joint, coef in zip(joints, coefs, strict=True)}
        return found

    def _is_one_drive(self, joints: list[int]) -> bool:
        """Tell whether joints are coupled to each other, so that what pulls them is the servo of all."""
        leaders = {own.joint: own.follows for own in self.couplings}
        return len({leaders.get(name, name) for name in self.joint_names(joints)}) == 1

    def _stiffness(self, actuator: int, lever: float) -> float:
        """The stiffness Nm/rad that an actuator gives its joint: 0 of a motor, which holds no place."""
        return max(0.0, -float(self.model.actuator_biasprm[actuator, 1])) * lever**2

    def _torque(self, joint: int, servo: tuple[int, float] | None) -> float | None:
        """The torque Nm that a joint has both ways, or None where the MJCF states none."""
        m = self.model
        found = [_both_ways(m.jnt_actfrcrange[joint])] if m.jnt_actfrclimited[joint] else []
        if servo is not None:
            actuator, lever = servo
            free = m.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
            if m.actuator_forcelimited[actuator]:
                found.append(lever * _both_ways(m.actuator_forcerange[actuator]))
            elif free and m.actuator_ctrllimited[actuator]:
                most = abs(float(m.actuator_gainprm[actuator, 0])) * _both_ways(
                    m.actuator_ctrlrange[actuator]
                )
                found.append(lever * most)
        return min(found) if found and 0.0 < min(found) < np.inf else None


def _both_ways(limits: Array) -> float:
    """Return the extent of a range (2,) to both sides of 0."""
    return float(min(-limits[0], limits[1]))
