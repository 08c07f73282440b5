"""Hands that float: our Allegro, or any hand as MJCF with its own joint names."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco

from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import check_file, expand
from dexgrasp_env.robot.cell import default_cell, make_cell
from dexgrasp_env.robot.foreign import described
from dexgrasp_env.robot.model import set_limits
from dexgrasp_env.robot.robot import Hand

ALLEGRO = "allegro"


@dataclass(frozen=True)
class HandModel:
    """A hand without an arm; its frame is the world frame of its MJCF file (for our Allegro the palm frame).

    Attributes:
        name: "allegro", or the stem of the file.
        path: of the MJCF file.
        own_gains: whether the servos keep the gains of the file; hands of robot files take those of the protocol.
        part: of a robot file, whose palm frame is the hand's frame, and whose limits count.
    """

    name: str
    path: Path
    own_gains: bool = True
    part: Hand | None = None

    def spec(self) -> mujoco.MjSpec:
        """Return a fresh specification without what is only to be seen, its files named by absolute paths."""
        spec = self._described()
        for geom in [g for g in spec.geoms if not (g.contype or g.conaffinity)]:
            spec.delete(geom)
        folder = (self.path.parent / spec.meshdir).resolve()
        for mesh in spec.meshes:
            if mesh.file:
                mesh.file = str(folder / mesh.file)
        spec.meshdir = ""
        return spec

    def _described(self) -> mujoco.MjSpec:
        if self.part is not None:
            spec = described(self.part)
            set_limits(spec, self.part.joints)
            return spec
        try:
            return mujoco.MjSpec.from_file(str(self.path))
        except (ValueError, OSError) as error:
            raise InputError(
                f"hand {str(self.path)!r} is no usable MJCF file: {_first_line(error)}"
            ) from None

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The hand alone, its base fixed in the world.

        Raises:
            InputError: if the file cannot be compiled.
        """
        try:
            return self.spec().compile()
        except ValueError as error:
            raise InputError(f"hand {str(self.path)!r} does not compile: {_first_line(error)}") from None

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """The joints in the order of the file.

        Raises:
            InputError: if a joint is neither a hinge nor a slide, or nothing drives the hand.
        """
        model = self.model
        kinds = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
        names = tuple(model.joint(i).name for i in range(model.njnt))
        if not names or any(int(kind) not in kinds for kind in model.jnt_type):
            raise InputError(
                f"hand {self.name}: valid joints are hinges and slides, at least one, and no free base"
            )
        if model.nu == 0:
            raise InputError(f"hand {self.name} has no actuators: position servos are needed to close it")
        return names


def find_hand(hand: str | Hand) -> HandModel:
    """Return our Allegro by its name, or a hand by the path of its MJCF file, of a robot's file, or of what that says.

    Raises:
        InputError: if there is no such hand.
    """
    if isinstance(hand, Hand) and hand.stamp != default_cell().robot.hand.stamp:
        return HandModel(hand.name, hand.mjcf, own_gains=False, part=hand)
    if isinstance(hand, Hand) or hand == ALLEGRO:
        return HandModel(ALLEGRO, asset_path("robot", "allegro.xml"), own_gains=False)
    path = expand(hand)
    if not path.is_file():
        raise InputError(
            f"unknown hand {hand!r}: valid are {ALLEGRO}, or the path of an MJCF file or of a robot"
        )
    check_file(path)
    if path.suffix in (".yaml", ".yml"):
        return find_hand(make_cell(path).robot.hand)
    return HandModel(path.stem, path.resolve())


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
