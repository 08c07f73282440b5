"""Reader of exported trajectories. NB: it shares no code with what writes them, so that it can find their faults."""

from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from dexgrasp.grasp.field_types import CORNERS, Parts
from dexgrasp_env.arrays import Array, array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import check_file, read_json_object, readable
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.table import SeenTable
from dexgrasp_env.valid import Names, Rule, Word, check, list_of, number, read


@dataclass(frozen=True, eq=False)
class Rows:
    """One controller's part: times (T,) s, positions (T, n) rad."""

    times: Array
    positions: Array


Seconds = Annotated[float, number(ge=0)]


@dataclass(frozen=True)
class Segment:
    """A stretch of the trajectory: its name, when it starts and ends, s."""

    name: Word
    start: Seconds
    end: Seconds


def _segments(value: Any) -> dict[str, Segment]:
    found = list_of(Segment, len(SEGMENTS), len(SEGMENTS + PLACING), more=True).validate(value)
    if tuple(one.name for one in found) not in (SEGMENTS, SEGMENTS + PLACING):
        raise ValueError
    return {one.name: one for one in found}


SEGMENTS = ("approach", "close", "squeeze", "lift")
PLACING = ("carry", "set_down", "release", "retreat")
"""The segments of a trajectory; the last four of one that sets the object down."""
_SEGMENTS = Rule(
    f"a list of {', '.join(SEGMENTS)} (and {', '.join(PLACING)}), each with name, start and end", _segments
)


@dataclass(frozen=True, eq=False)
class Facts:
    """Metadata beside the rows.

    Attributes:
        mount: of the hand.
        cell: what the trajectory was made in.
        segments: by name, in their order.
        parts: corners (V, 3) m of the object's convex parts, from the robot's base.
        around: the same of what stands around it, which may be nothing.
        rejected: checks of `verify` that the grasp fails.
        table: where the table was seen; None where it is the cell's.
        placed: (4, 4) motion of the object from where it lies to where it is let go of, in the frame of the robot's
            base; None of one that is held.
        any_heading: whether it may stand turned about the vertical.
    """

    mount: Word
    cell: Word
    segments: Annotated[dict[str, Segment], _SEGMENTS]
    parts: Parts
    around: tuple[Annotated[Array, CORNERS], ...]
    rejected: tuple[str, ...]
    table: SeenTable | None = None
    placed: Annotated[Array | None, array(4, 4)] = None
    any_heading: bool = False

    def __post_init__(self) -> None:
        if (self.placed is None) != (len(self.segments) == len(SEGMENTS)):
            raise InputError(
                "a trajectory that sets the object down says where to, `placed`, and has all segments"
            )


@dataclass(frozen=True, eq=False)
class Recording:
    """A trajectory as read: arm, hand, and what is said beside them."""

    arm: Rows
    hand: Rows
    facts: Facts

    def at(self, times: Array) -> Array:
        """Return the set-points (T, n) rad of the robot at times (T,) s, on lines between rows."""
        parts = (self.arm, self.hand)
        return np.stack([np.interp(times, p.times, q) for p in parts for q in p.positions.T], axis=1)


def read_trajectory(path: Path, cell: Cell) -> Recording:
    """Read a folder with `arm.csv`, `hand.csv` and `segments.json`, one of its tables, or a `trajectory.json`.

    Args:
        path: of the folder or file.
        cell: whose robot's joints it must be of.

    Raises:
        InputError: saying what is missing, malformed, or cut off.
    """
    robot = cell.robot
    names = {"arm": robot.arm.joints.names, "hand": robot.hand.joints.names}
    if path.is_dir() and (path / "trajectory.json").is_file() and not (path / "arm.csv").is_file():
        path = path / "trajectory.json"
    if path.suffix.lower() == ".json":
        content = read_json_object(path, "export it again")
        arm, hand = (_part(content.get(key), key, names[key], path) for key in names)
        return Recording(arm, hand, read(Facts, content, f"{path}:", more=True))
    folder = path if path.is_dir() else path.parent
    files = [folder / f"{key}.csv" for key in names]
    if not all(file.is_file() for file in files):
        raise InputError(
            f"{path} is no trajectory: valid are a folder with arm.csv and hand.csv, or trajectory.json"
        )
    about = folder / "segments.json"
    missing = f"{about} is missing, which says where the object is and when what happens: export it again"
    facts = read(Facts, read_json_object(about, "export it again", missing), f"{about}:", more=True)
    arm, hand = (_read_csv(file, names[file.stem]) for file in files)
    return Recording(arm, hand, facts)


def _part(part: Any, key: str, names: Names, path: Path) -> Rows:
    if not isinstance(part, dict) or part.get("joints") != list(names):
        raise InputError(f"{path}: {key!r} must have joints {', '.join(names)}")
    period = check(f"{path}: the period of {key!r}, s,", part.get("period"), number(gt=0, lt=1))
    positions = _numbers(part.get("positions"), len(names), f"{path}: positions of {key!r}")
    return Rows(period * np.arange(len(positions)), positions)


def _read_csv(path: Path, names: Names) -> Rows:
    try:
        with readable(path):
            check_file(path)
            with path.open(encoding="utf-8") as file:
                # ten minutes at 1 kHz
                header, *rows = [line.rstrip("\n").split(",") for line in islice(file, 600_000)] or [[""]]
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no CSV ({error})") from None
    if header != ["t", *names]:
        raise InputError(f"{path}: the header must be t, {', '.join(names)}")
    table = _numbers(rows, len(names) + 1, str(path))
    return Rows(table[:, 0], table[:, 1:])


def _numbers(rows: Any, width: int, where: str) -> Array:
    try:
        table = np.array(rows, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{where}: every row must hold {width} numbers (was the file cut off?)") from None
    if table.ndim != 2 or table.shape[1] != width or len(table) < 2 or not np.isfinite(table).all():
        raise InputError(
            f"{where}: two or more rows of {width} finite numbers are needed, got shape {table.shape}"
        )
    return table
