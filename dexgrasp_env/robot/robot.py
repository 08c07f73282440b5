"""The robot as a value: an arm, a hand and how the one sits on the other; everything of either comes from its file.

Vectors of joints have the arm's joints first, then the hand's, each in the order of its file.
"""

from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import unknown_name
from dexgrasp_env.files import content_hash
from dexgrasp_env.robot.description_text import description_text
from dexgrasp_env.valid import Names, Natural, Positive, Positives, Rule, Word, list_of, number, read, several

Numbers = tuple[float, ...]
Vector = Annotated[Numbers, several(number(), 3)]
SLIDE = 0.1
"""m of a slide that count as much as a radian of a hinge."""
STRONGEST = 8.0  # Nm: a joint of a finger has less; what states more, a placeholder mostly, presses with this
_FARTHEST = 0.5  # m from the arm's last link to the palm frame


def _near(value: Any) -> Numbers:
    position = several(number(), 3).validate(value)
    if np.linalg.norm(position) > _FARTHEST:
        raise ValueError
    return position


def _unit(value: Any) -> Numbers:
    quat = several(number(), 4).validate(value)
    if abs(np.linalg.norm(quat) - 1.0) > 1e-6:
        raise ValueError
    return quat


Quaternion = Annotated[Numbers, Rule("a unit quaternion w, x, y, z", _unit)]


@dataclass(frozen=True)
class Frame:
    """A frame in that of a body: position (3,) m and quaternion wxyz (4,)."""

    position: Vector
    quat_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Joints:
    """Names, limits and gains of joints: rad, s, Nm; gains Nm/rad and Nm s/rad."""

    names: Names
    lower: Numbers
    upper: Numbers
    velocity: Positives
    acceleration: Positives
    jerk: Positives
    torque: Positives
    stiffness: Positives
    damping: Positives = ()  # of the servos; without it they are critically damped

    @property
    def ranges(self) -> Array:
        """Their lower and upper limits, (2, n) rad."""
        return np.array([self.lower, self.upper])


@dataclass(frozen=True)
class Adapter:
    """The plate between flange and hand, for pictures: along the last link's z, m; names of its look in the MJCF."""

    start: float
    end: float
    radius: float
    look: Word
    material: Word


@dataclass(frozen=True)
class Arm:
    """An arm.

    Attributes:
        name: of it.
        mjcf: its description; not a part of what it is called, its content is.
        joints: from the base to the flange, each turning about its z axis.
        bodies: from the base, which is fixed to the world, to the last link, which bears the hand.
        home: rad, where every episode begins.
        shoulder: (3,) m in the frame of the base, where `reach` counts from.
        reach: m.
        shaken: the two joints that a shaking turns.
        adapter: the plate under the hand, if any.
        frame: of the flange in the last body of an MJCF that has frames of its own; see `rebuilt`.
        plinth: so many bodies from the base on may be near the table beside it: they stand over the plinth.
        starts: rad, where inverse kinematics begins, first joints less the direction of the goal; without them home,
            its last joint and its first one turned to either side.
    """

    name: Word
    mjcf: Path = field(repr=False)
    joints: Joints
    bodies: Names
    home: Numbers
    shoulder: Vector
    reach: Positive
    shaken: tuple[Natural, Natural]
    adapter: Adapter | None = None
    frame: Frame | None = field(default=None, repr=False)
    plinth: Natural = field(default=4, repr=False)
    starts: tuple[Numbers, ...] = field(default=(), repr=False)


@dataclass(frozen=True)
class Finger:
    """A finger of the hand.

    Attributes:
        name: of it.
        joints: names, from the palm to the tip.
        bodies: names, from the palm to the tip.
        tip: name of the site at the centre of the tip's sphere, and of the tip's collision geom.
        pad: (3,) outward normal of the soft side, frame of the last body.
        aside: rad, its posture where it takes no part in a grasp.
        frame: of the tip in the last body, z out of the tip and x out of its pad, where the hand states its own.
    """

    name: Word
    joints: Names
    bodies: Names
    tip: Word
    pad: Vector = (1.0, 0.0, 0.0)
    aside: Numbers = ()
    frame: Frame | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Mount:
    """The palm frame in the frame of the arm's last link: position (3,) m and quaternion wxyz (4,)."""

    name: Word
    position: Annotated[Numbers, Rule(f"three numbers, within {_FARTHEST} m of the last link", _near)]
    quat_wxyz: Quaternion


def _mounts(value: Any) -> tuple[Mount, ...]:
    return tuple(read(Mount, {"name": name, **mount}, f"mount {name}") for name, mount in value.items())


@dataclass(frozen=True)
class Coupling:
    """A joint that stands where another one does: at `ratio` times its place, and `offset` (rad or m) farther."""

    joint: Word
    follows: Word
    ratio: Annotated[float, number()] = 1.0
    offset: Annotated[float, number()] = 0.0


@dataclass(frozen=True)
class Tendon:
    """Tendon of one servo: joints of a finger, from the palm out, by the sum of their places times `coefs`.

    Nothing else holds them. Free, all turn at once; on an object all but the last, of coefficient 1, stand on stops.
    """

    joints: Names
    coefs: Positives


FINGERS = list_of(Finger, 2)


@dataclass(frozen=True)
class Hand:
    """A hand.

    Attributes:
        name: of it.
        mjcf: its description; not a part of what it is called, its content is.
        palm: the palm's body and site: z towards the fingers, +x out of the palm's face.
        joints: all of them, finger by finger.
        fingers: in the order of the joints.
        grasp: names of the fingers of a grasp; the first opposes the others.
        grasps: the like, to be tried in turn where `grasp` gives none that bears the weight.
        open: rad, the pre-shape of a grasp.
        mounts: how the hand may sit on an arm.
        beside_palm: one more link whose distance from the palm is kept; empty where there is none.
        self_pairs: bodies that the hand's own motion can bring together; found by sampling where none is named.
        excluded: bodies that are not to collide, besides those of an MJCF that has frames of its own.
        frame: of the palm in its body, of an MJCF that has frames of its own.
        tip_radius: m, of the spheres that the tips are like.
        tip_length: m of the last links, from their ends, that may touch; without it two radii.
        torsion: m, torsional friction of soft tips over sliding friction; 0: they turn freely.
        couplings: of joints that follow others rigidly.
        tendons: of joints that share a servo.
        held: joints of an MJCF that has frames of its own, a wrist's for one, that stand still at 0.
    """

    name: Word
    mjcf: Path = field(repr=False)
    palm: Word
    joints: Joints
    fingers: Annotated[tuple[Finger, ...], FINGERS]
    grasp: Names
    open: Numbers
    mounts: Annotated[tuple[Mount, ...], Rule("a mapping of mounts", _mounts)]
    beside_palm: str = ""
    self_pairs: tuple[tuple[Word, Word], ...] = ()
    excluded: tuple[tuple[Word, Word], ...] = field(default=(), repr=False)
    frame: Frame | None = field(default=None, repr=False)
    tip_radius: Positive = field(default=0.014, repr=False)
    tip_length: Annotated[float, number(ge=0)] = field(default=0.0, repr=False)
    torsion: Annotated[float, number(ge=0, le=0.1)] = field(default=0.0, repr=False)
    couplings: Annotated[tuple[Coupling, ...], list_of(Coupling)] = field(default=(), repr=False)
    tendons: Annotated[tuple[Tendon, ...], list_of(Tendon)] = field(default=(), repr=False)
    held: Names = field(default=(), repr=False)
    grasps: tuple[Names, ...] = field(default=(), repr=False)

    @property
    def bodies(self) -> Names:
        """The palm, then each finger's bodies."""
        return (self.palm, *chain.from_iterable(finger.bodies for finger in self.fingers))

    @cached_property
    def drive(self) -> tuple[Array, Array]:
        """C (h, h) and c (h,): joints of a hand that grasps are at C q + c; those without a servo have no say in q."""
        names = self.joints.names
        alone = np.eye(len(names))
        C, c = alone.copy(), np.zeros(len(names))
        for own in self.couplings:
            row = names.index(own.joint)
            C[row], c[row] = own.ratio * alone[names.index(own.follows)], own.offset
        for row in (names.index(joint) for tendon in self.tendons for joint in tendon.joints[:-1]):
            C[row], c[row] = 0.0, self.joints.lower[row]
        return C, c

    @cached_property
    def free(self) -> tuple[Array, Array]:
        """Like `drive`, of a hand that touches nothing: a tendon turns its joints from their stops by its coefs."""
        C, c = map(np.copy, self.drive)
        for tendon in self.tendons:
            rows, coefs = [self.joints.names.index(joint) for joint in tendon.joints], np.array(tendon.coefs)
            share = np.outer(coefs, coefs) / (coefs @ coefs)
            C[np.ix_(rows, rows)] = share
            c[rows] = (np.eye(len(rows)) - share) @ self.joints.ranges[0, rows]
        return C, c

    @cached_property
    def stamp(self) -> str:
        """Stamp of the hand for learned parts: its name, and a hash of its shape; limits and gains do not count."""
        shape = repr([(f, f.frame) for f in self.fingers]), self.frame, self.grasp, self.tip_radius
        return f"{self.name}-{content_hash(description_text(self.mjcf), *shape)[:8]}"

    def finger(self, name: str) -> Finger:
        """Return the finger of that name."""
        return next(finger for finger in self.fingers if finger.name == name)

    def mount(self, name: str) -> Mount:
        """Return the mount of that name.

        Raises:
            InputError: if there is none.
        """
        for mount in self.mounts:
            if mount.name == name:
                return mount
        raise unknown_name("mount", name, [mount.name for mount in self.mounts])


def _joined(name: str) -> "cached_property[Array]":
    """A read-only array (n,) of the arm's numbers and the hand's."""
    return cached_property(
        lambda own: _fixed(*getattr(own.arm.joints, name), *getattr(own.hand.joints, name))
    )


@dataclass(frozen=True)
class Robot:
    """An arm with a hand; n joints, F fingers, G of which grasp."""

    name: str
    arm: Arm
    hand: Hand
    mount: Mount

    lower = _joined("lower")
    upper = _joined("upper")
    velocity = _joined("velocity")
    acceleration = _joined("acceleration")
    jerk = _joined("jerk")
    torque = _joined("torque")
    stiffness = _joined("stiffness")

    @cached_property
    def joints(self) -> Names:
        """Names of all joints, which their actuators share, in the order of every vector of joints."""
        return self.arm.joints.names + self.hand.joints.names

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def arm_dof(self) -> int:
        """Number of the arm's joints, which come first."""
        return len(self.arm.joints.names)

    @cached_property
    def bodies(self) -> Names:
        """Names of all bodies: the arm's from the base, the palm, the fingers'."""
        return self.arm.bodies + self.hand.bodies

    @cached_property
    def home(self) -> Array:
        """Arm at home and hand open, (n,) rad."""
        return _fixed(*self.arm.home, *self.hand.open)

    @cached_property
    def drive(self) -> tuple[Array, Array]:
        """C (n, n) and c (n,), those of the hand, the arm's joints being where they are."""
        return self._with_arm(self.hand.drive)

    @cached_property
    def free(self) -> tuple[Array, Array]:
        """Like `drive`, of a hand that touches nothing."""
        return self._with_arm(self.hand.free)

    def _with_arm(self, hand: tuple[Array, Array]) -> tuple[Array, Array]:
        C, c = np.eye(self.dof), np.zeros(self.dof)
        C[self.arm_dof :, self.arm_dof :], c[self.arm_dof :] = hand
        return C, c

    def freed(self, q: Array) -> Array:
        """Return where joints (..., n) rad are when nothing is touched and the servos are told the same."""
        C, c = self.free
        return q @ C.T + c if self.hand.couplings or self.hand.tendons else q

    def drawn(self, count: int) -> Array:
        """Return postures (count, n) rad, evenly from the joints' ranges, always the same."""
        C, c = self.free
        postures = np.random.default_rng(0).uniform(self.lower, self.upper, (count, self.dof)) @ C.T + c
        return np.clip(postures, self.lower, self.upper)

    @cached_property
    def grasping(self) -> tuple[Finger, ...]:
        """The G fingers of a grasp, the opposing one first."""
        return tuple(map(self.hand.finger, self.hand.grasp))

    @cached_property
    def stamp(self) -> str:
        """Stamp of the robot for learned policies: names, and hashes of arm and hand; limits do not count."""
        arm = self.arm
        return f"{arm.name}-{content_hash(description_text(arm.mjcf), arm.frame)[:8]}-{self.hand.stamp}"

    @property
    def arm_columns(self) -> slice:
        """Columns of the arm's joints in a vector of joints."""
        return slice(self.arm_dof)

    @property
    def hand_columns(self) -> slice:
        """Columns of the hand's joints in a vector of joints."""
        return slice(self.arm_dof, None)

    @cached_property
    def columns(self) -> dict[str, slice]:
        """Columns of each finger's joints in a vector of joints."""
        return {
            finger.name: slice(first := self.joints.index(finger.joints[0]), first + len(finger.joints))
            for finger in self.hand.fingers
        }

    @cached_property
    def tips(self) -> Names:
        """Names of the tips' sites and geoms, in the order of the fingers."""
        return tuple(finger.tip for finger in self.hand.fingers)

    @cached_property
    def hash(self) -> str:
        """A hash of all that the files say, descriptions and what they include, attach or name as meshes."""
        parts: tuple[Any, ...] = (self.arm, self.hand, *self.hand.fingers)
        late = [
            (each.name, value)
            for part in parts
            for each in fields(part)
            if not each.repr and (value := getattr(part, each.name)) != each.default and each.name != "mjcf"
        ]
        return content_hash(repr(self), *(description_text(part.mjcf) for part in parts[:2]), *late)[:8]


def _fixed(*values: float) -> Array:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
