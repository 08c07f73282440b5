"""A grasp of a floating hand, as every protocol takes it, whatever file it came from."""

from dataclasses import dataclass, replace

from dexgrasp.scoring.hand import HandModel
from dexgrasp_env.arrays import Array
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.poses import shifted


@dataclass(frozen=True)
class HandStage:
    """Where the hand is asked to be.

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
class Candidate:
    """A grasp to be scored.

    Attributes:
        source: the file it came from, with its number where the file holds several.
        hand: the hand.
        object: what is grasped, its frame at the centre of mass.
        T_world_object: (4, 4).
        pregrasp: around the object, touching nothing.
        grasp: in contact.
        squeeze: set-points inside the object.
        servo_kp: Nm/rad, one or (n,), of the servos that the squeeze is meant for; None where the file does not say:
            set-points are then taken as they are.
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
        """Return the squeeze for servos of another gain, so that they press with the same torques."""
        if self.servo_kp is None or servo_kp is None:
            return self.squeeze
        press = (self.squeeze.joints - self.grasp.joints) * (self.servo_kp / servo_kp)
        return replace(self.squeeze, joints=self.grasp.joints + press)

    def displaced(self, T: Array) -> "Candidate":
        """Return the grasp with the hand displaced by `T` (4, 4) in its own frame at every stage."""

        def moved(stage: HandStage) -> HandStage:
            """Return the stage in the other frame."""
            return replace(stage, T_world_hand=stage.T_world_hand @ T)

        return replace(
            self, pregrasp=moved(self.pregrasp), grasp=moved(self.grasp), squeeze=moved(self.squeeze)
        )
