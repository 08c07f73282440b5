"""Options of `dexgrasp plan` that constrain the grasp."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dexgrasp.cli.command import Options
from dexgrasp_env.valid import Positive, check

if TYPE_CHECKING:
    from dexgrasp.geometry.request import GraspRequest, Region
    from dexgrasp_env.arrays import Array, Mask


class RequestOptions(Options):
    """Constraints on the grasp, in the frame of the robot's base, m.

    Attributes:
        hold: regions that all contacts lie in: box:X0,Y0,Z0,X1,Y1,Z1, sphere:X,Y,Z,RADIUS, or mask:FILE.npy, one bool
            for each point or pixel of a cloud, or each face of a mesh file.
        avoid: regions that no contact lies in, stated alike.
        approach: the way that the palm faces: top, side, front, or X,Y,Z; with ,DEGREES behind, how far it may be off
            (30; front 45).
        fingers: that make the contacts, one of the grasps of the hand (default: the planner's choice).
        max_force: each finger presses with at most N newtons.
        place: the object is set down after the lift: X Y for the middle of its outline, Z of what it then stands on,
            and YAW, degrees by which it is turned (default: any).
        budget: the search ends after so many seconds, with what it has.
    """

    hold: Annotated[tuple[str, ...], "REGION"] = ()
    avoid: Annotated[tuple[str, ...], "REGION"] = ()
    approach: Annotated[str | None, "WAY"] = None
    fingers: Annotated[tuple[str, ...], "NAME"] = ()
    max_force: Annotated[Positive | None, "N"] = None
    place: Annotated[tuple[float, ...] | None, "NUMBER"] = None
    budget: Annotated[Positive | None, "SECONDS"] = None

    @property
    def of_request(self) -> list[str]:
        """Options of this group that were given, as they are typed."""
        return self.given(*RequestOptions.__annotations__)

    def grasp_request(self, marked: "Callable[[Mask], Array]", **known: Any) -> "GraspRequest":
        """Return the request of these options.

        Args:
            marked: returns the points (N, 3) m, frame of the robot's base, that a mask marks.
            **known: fields of `GraspRequest` from other options.

        Raises:
            InputError: for a region, an approach or a mask that is not valid.
        """
        from dexgrasp.geometry.request import PLACE_WORDS, GraspRequest

        hold, avoid = (
            tuple(self._region(name, said, marked) for said in getattr(self, name))
            for name in ("hold", "avoid")
        )
        goal = None if self.place is None else check("place", self.place, PLACE_WORDS)
        known |= {"approach": self.approach, "fingers": self.fingers, "max_force": self.max_force}
        return GraspRequest(hold, avoid, seconds=self.budget, goal=goal, **known)

    def _region(self, name: str, said: Any, marked: "Callable[[Mask], Array]") -> "Region":
        from dexgrasp.geometry.request import REGION, Region

        if (mask := self._mask(name, said)) is not None:
            return Region.of_points(marked(mask))
        region: Region = check(name, said, REGION)
        return region

    def _mask(self, name: str, said: Any) -> "Mask | None":
        """Return the mask of a region; None for one that is stated in numbers."""
        from dexgrasp_env.perception.selection import read_mask

        kind, _, path = said.partition(":")
        return read_mask(Path(path)) if kind == "mask" else None
