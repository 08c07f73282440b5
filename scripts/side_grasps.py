"""How many grasps of an evaluation come from the side, by object.

    dexgrasp evaluate --agents hardcoded bilevel --objects all20 --trials 6 --protocol presented --seed 40211 --out RUN
    python scripts/side_grasps.py RUN

From the side: the palm looks less than 45 degrees down where the fingers close. The supplementary (3.4) asks for such
grasps of the castle, the lego brick and the hairspray bottle.
"""

import sys
from pathlib import Path
from typing import Annotated

import numpy as np

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.store import read_rows
from dexgrasp.evaluation.summary import grouped
from dexgrasp.grasp.file import read_grasp
from dexgrasp.mechanics.kinematics.forward import empty_frames, forward
from dexgrasp.mechanics.kinematics.tree import robot_tree

STEEP = np.sin(np.radians(45.0))


def from_side(path: Path) -> bool:
    """Return whether the palm of a grasp file looks less than 45 degrees down."""
    record = read_grasp(path)
    tree = robot_tree(record.here)
    frames = empty_frames(tree)
    forward(record.q, tree, frames)
    return bool(-(frames.R[tree.palm] @ tree.palm_rotation)[2, 0] < STEEP)


class Sides(Script):
    """Prints object, grasps, grasps from the side.

    Attributes:
        folder: of an evaluation.
    """

    folder: Argument[Annotated[Folder, "RUN"]]

    def run(self) -> int:
        planned = [row for row in read_rows(self.folder) if "grasp" in row]
        for name, rows in grouped(planned, "object").items():
            sides = sum(from_side(self.folder / row["grasp"]) for row in rows)
            print(f"{name:20} {len(rows):4} grasps, {sides:4} from the side")
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Sides))
