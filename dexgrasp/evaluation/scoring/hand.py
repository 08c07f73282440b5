"""Floating hands, and grasps of them in the form that every protocol takes.

A hand is our Allegro, or any hand as MJCF with its own joint names.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import mujoco

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError, first_line
from dexgrasp_env.files import check_file, expand
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.poses import shifted
from dexgrasp_env.robot.cell import default_cell, make_cell
from dexgrasp_env.robot.model import set_drives
from dexgrasp_env.robot.rebuilt import described
from dexgrasp_env.robot.robot import Hand
from dexgrasp_env.yaml_file import YAML_SUFFIXES

ALLEGRO = "allegro"


@dataclass(frozen=True)
class HandModel:
    """A hand without an arm; its frame is the world frame of its MJCF file (for our Allegro the palm frame).

    Attributes:
        name: "allegro", or the stem of the file.
        path: of the MJCF file.
        part: hand of a robot file; its palm frame is the hand's frame, its limits, couplings and tendons apply, and its
            servos have the gains of the protocol, one set-point a joint. None: a hand with servos of its own.
    """

    name: str
    path: Path
    part: Hand | None = None

    def spec(self, servo_kp: float = 1.0) -> mujoco.MjSpec:
        """Return a new specification without visual shapes, its files named by absolute paths.

        Args:
            servo_kp: Nm/rad of the servos of a robot's hand.
        """
        spec = self._described(servo_kp)
        for geom in [g for g in spec.geoms if not (g.contype or g.conaffinity)]:
            spec.delete(geom)
        folder = (self.path.parent / spec.meshdir).resolve()
        for mesh in spec.meshes:
            if mesh.file:
                mesh.file = str(folder / mesh.file)
        spec.meshdir = ""
        return spec

    def _described(self, servo_kp: float) -> mujoco.MjSpec:
        if self.part:
            spec, joints = described(self.part), self.part.joints
            same = replace(joints, stiffness=(servo_kp,) * len(joints.names))
            set_drives(spec, replace(self.part, joints=same))
            return spec
        try:
            return mujoco.MjSpec.from_file(str(self.path))
        except (ValueError, OSError) as error:
            raise InputError(f"hand {str(self.path)!r} is no usable MJCF file: {first_line(error)}") from None

    @cached_property
    def model(self) -> mujoco.MjModel:
        """Compiled model of the hand, its base fixed in the world.

        Raises:
            InputError: if the file cannot be compiled.
        """
        try:
            return with_decimal_points(self.spec().compile)
        except ValueError as error:
            raise InputError(f"hand {str(self.path)!r} does not compile: {first_line(error)}") from None

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in the order of the file.

        Raises:
            InputError: if a joint is neither a hinge nor a slide, or nothing drives the hand.
        """
        model = self.model
        kinds = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
        names = tuple(model.joint(i).name for i in range(model.njnt))
        if not names or not kinds.issuperset(model.jnt_type.tolist()):
            raise InputError(
                f"hand {self.name}: valid joints are hinges and slides, at least one, and no free base"
            )
        if model.nu == 0:
            raise InputError(f"hand {self.name} has no actuators: position servos are needed to close it")
        return names


def find_hand(hand: str | Hand) -> HandModel:
    """Return a hand: our Allegro by its name, another by the path of its MJCF or robot file, or as that was read.

    Raises:
        InputError: if there is no such hand.
    """
    ours = default_cell().robot.hand
    if hand == ALLEGRO or (isinstance(hand, Hand) and hand.stamp == ours.stamp):
        return HandModel(ALLEGRO, ours.mjcf, ours)
    if isinstance(hand, Hand):
        return HandModel(hand.name, hand.mjcf, hand)
    path = expand(hand)
    if not path.is_file():
        raise InputError(
            f"unknown hand {hand!r}: valid are {ALLEGRO}, or the path of an MJCF file or of a robot"
        )
    check_file(path)
    if path.suffix in YAML_SUFFIXES:
        return find_hand(make_cell(path).robot.hand)
    return HandModel(path.stem, path.resolve())


@dataclass(frozen=True)
class HandStage:
    """Set-points of hand base and joints.

    Attributes:
        T_world_hand: (4, 4) of the hand's frame; z up, the table's top at z = 0.
        joints: (n,) rad or m, set-points in the order of the hand's joints.
    """

    T_world_hand: Array
    joints: Array

    def shifted(self, offset: Array) -> "HandStage":
        """Return the stage with the hand moved by (3,) m in the world."""
        return replace(self, T_world_hand=shifted(self.T_world_hand, offset))


@dataclass(frozen=True)
class FloatingGrasp:
    """Grasp of a floating hand on an object, to be scored.

    Attributes:
        source: path of its file, with the index where the file holds several.
        hand: the hand.
        object: that is grasped, its frame at the centre of mass.
        T_world_object: (4, 4).
        pregrasp: around the object, touching nothing.
        grasp: in contact.
        squeeze: set-points inside the object.
        servo_kp: Nm/rad, one or (n,), of the servos that the squeeze is made for; None where the file does not state
            them: set-points are then taken as they are.
    """

    source: str
    hand: HandModel
    object: ObjectModel
    T_world_object: Array
    pregrasp: HandStage
    grasp: HandStage
    squeeze: HandStage
    servo_kp: float | Array | None = None

    def squeeze_for(self, servo_kp: float | None) -> HandStage:
        """Return the squeeze rescaled for servos of another gain, Nm/rad, so that torques stay the same."""
        if self.servo_kp is None or servo_kp is None:
            return self.squeeze
        press = (self.squeeze.joints - self.grasp.joints) * (self.servo_kp / servo_kp)
        return replace(self.squeeze, joints=self.grasp.joints + press)

    def displaced(self, T: Array) -> "FloatingGrasp":
        """Return the grasp with the hand displaced by `T` (4, 4) in its own frame at every stage."""
        stages = {name: getattr(self, name) for name in ("pregrasp", "grasp", "squeeze")}
        moved = {name: replace(own, T_world_hand=own.T_world_hand @ T) for name, own in stages.items()}
        return replace(self, **moved)
