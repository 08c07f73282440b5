"""Options of `dexgrasp plan` that say where and how an object is to be grasped."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from dexgrasp.cli.command import Options
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import check

if TYPE_CHECKING:
    from dexgrasp.geometry.request import GraspRequest, Region
    from dexgrasp_env.perception.cloud import Cloud


class Request(Options):
    """Constraints on the grasp, in the frame of the robot's base, m.

    Attributes:
        hold: regions that all contacts lie in: box:X0,Y0,Z0,X1,Y1,Z1, sphere:X,Y,Z,RADIUS, or of a cloud
            mask:FILE.npy, one bool for each of its points or pixels.
        avoid: regions that no contact lies in, stated alike.
        approach: the way that the palm faces: top, side, front, or X,Y,Z; with ,DEGREES behind, how far it may be off
            (30; front 45).
        fingers: that make the contacts, one of the grasps of the hand (default: the planner's choice).
    """

    hold: Annotated[tuple[str, ...], "REGION"] = ()
    avoid: Annotated[tuple[str, ...], "REGION"] = ()
    approach: Annotated[str | None, "WAY"] = None
    fingers: Annotated[tuple[str, ...], "NAME"] = ()

    def grasp_request(self, scan: "Cloud | None" = None) -> "GraspRequest":
        """Return what is asked for.

        Args:
            scan: that masks are of.

        Raises:
            InputError: for what is no region, no way or no mask.
        """
        from dexgrasp.geometry.request import APPROACH_WORDS, GraspRequest

        approach = None if self.approach is None else check("approach", self.approach, APPROACH_WORDS)
        hold, avoid = (
            tuple(self._region(name, text, scan) for text in getattr(self, name))
            for name in ("hold", "avoid")
        )
        return GraspRequest(hold, avoid, approach, tuple(self.fingers))

    def _region(self, name: str, text: str, scan: "Cloud | None") -> "Region":
        from dexgrasp.geometry.request import REGION, Region
        from dexgrasp_env.perception.selection import TargetSelector, read_mask

        kind, _, path = text.partition(":")
        if kind != "mask":
            region: Region = check(name, text, REGION)
            return region
        if scan is None:
            raise InputError(f"{name}: a mask is of the points of a --cloud")
        marks = TargetSelector(mask=read_mask(Path(path), None)).marks(scan)
        return Region.of_points(scan.points[marks])
