"""Options of `dexgrasp plan --cloud`: a scene of one's own, and what of it is meant."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from dexgrasp.cli.command import File, Options
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Positive

if TYPE_CHECKING:
    from dexgrasp_env.perception.detected import DetectedObject
    from dexgrasp_env.perception.selection import TargetSelector

_BESIDE = 0.15  # m from the object within which it is said what stands there


class Scan(Options):
    """Your own scene, instead of TARGET. Everything in it but the object that is meant is an obstacle.

    Attributes:
        cloud: ply, pcd, xyz, npy or npz in the robot base frame; or a folder with cameras.yaml and depth images.
        unit: of that file's coordinates.
        objects: list the objects that are seen, and plan nothing (with --out, a picture with their numbers).
        object_near: a point near the object that is meant, m.
        box: a box that holds the object that is meant, m.
        mask: npy, one bool or whole number for each point of the file, or each pixel of the folder's images.
        label: the object's number in the mask, where it has several.
        pixel: where a camera of the folder sees the object that is meant, column and row.
        mass: of the object, kg, where it is known.
    """

    cloud: File | None = None
    unit: Literal["m", "cm", "mm"] = "m"
    objects: bool = False
    object_near: Annotated[tuple[float, float, float] | None, "X", "Y", "Z"] = None
    box: Annotated[
        tuple[float, float, float, float, float, float] | None, "X0", "Y0", "Z0", "X1", "Y1", "Z1"
    ] = None
    mask: Annotated[Path | None, "FILE.npy"] = None
    label: Annotated[int | None, "K"] = None
    pixel: Annotated[tuple[str, str, str] | None, "CAMERA", "U", "V"] = None
    mass: Annotated[Positive | None, "KG"] = None

    @property
    def of_cloud(self) -> list[str]:
        """Options that were given and apply to clouds alone."""
        return [
            f"--{name.replace('_', '-')}"
            for name in Scan.__annotations__
            if name != "cloud" and getattr(self, name) not in (None, False, "m")
        ]

    def selector(self) -> "TargetSelector":
        """Return what is pointed at.

        Raises:
            InputError: for more than one way to point, or one that points at nothing.
        """
        import numpy as np

        from dexgrasp_env.perception.selection import TargetSelector, point_of_pixel, read_mask

        if sum(way is not None for way in (self.object_near, self.box, self.mask, self.pixel)) > 1:
            raise InputError("point in one way: --object-near, --box, --mask or --pixel")
        if self.label is not None and self.mask is None:
            raise InputError("--label is of a --mask")
        near = None if self.object_near is None else np.array(self.object_near)
        if self.pixel is not None:
            camera, u, v = self.pixel
            if not (u.isdecimal() and v.isdecimal()):
                raise InputError(f"--pixel {camera} {u} {v}: valid is a camera's name, a column and a row")
            near = point_of_pixel(Path(str(self.cloud)), camera, int(u), int(v))
        box = None if self.box is None else np.reshape(self.box, (2, 3))
        return TargetSelector(near, box, None if self.mask is None else read_mask(self.mask, self.label))


def list_lines(seen: "list[DetectedObject]") -> list[str]:
    """Return a line for each object."""
    lines = []
    for one in seen:
        gap = "none" if one.next > 1e3 else f"{100 * one.next:.1f} cm"
        lines.append(f"  {one.number}: {one}, the next {gap} away{'; ' * bool(one.doubt)}{one.doubt}")
    return lines


def tilt_line(tilt: float) -> str:
    """Return that a table was tilted by so many rad."""
    return (
        f"warning: the table is tilted by {57.29578 * tilt:.0f} degrees in the frame of the robot's base: levelled; "
        "all is said of the levelled frame"
    )


def chosen_line(seen: "list[DetectedObject]") -> str:
    """Return what is planned for, and what stands beside it."""
    first, *others = seen
    beside = [one for one in others if one.apart < _BESIDE]
    said = "; ".join(
        f"{one}, {100 * one.apart:.1f} cm away" for one in sorted(beside, key=lambda one: one.apart)
    )
    line = f"object: {first}; within {100 * _BESIDE:.0f} cm: {said or 'nothing'}"
    return (
        f"doubt: the object {first.doubt} (a --mask tells one object from another)\n" * bool(first.doubt)
        + line
    )
