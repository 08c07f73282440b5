"""How many grasps of an evaluation come from the side, by object.

    dexgrasp evaluate --agents hardcoded bilevel --objects all20 --trials 6 --protocol presented --seed 40211 --out RUN
    python scripts/side_grasps.py RUN

From the side: the palm looks less than 45 degrees down where the fingers close. The supplementary (3.4) asks for such
grasps of the castle, the lego brick and the hairspray bottle.
"""

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np

from dexgrasp.evaluation.store import read_rows
from dexgrasp.grasp.file import read_grasp
from dexgrasp.kinematics.forward import empty_frames, forward
from dexgrasp.kinematics.tree import robot_tree

STEEP = np.sin(np.radians(45.0))


def from_side(path: Path) -> bool:
    """Return whether the palm of a grasp file looks less than 45 degrees down."""
    record = read_grasp(path)
    tree = robot_tree(record.here)
    frames = empty_frames(tree)
    forward(record.q, tree, frames)
    return bool(-(frames.R[tree.palm] @ tree.palm_rotation)[2, 0] < STEEP)


def main(argv: list[str] | None = None) -> None:
    """Print object, grasps, grasps from the side."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, help="folder of an evaluation")
    run = parser.parse_args(argv).run
    found: defaultdict[str, list[bool]] = defaultdict(list)
    for row in read_rows(run):
        if "grasp" in row:
            found[row["object"]].append(from_side(run / row["grasp"]))
    for name, sides in found.items():
        print(f"{name:20} {len(sides):4} grasps, {sum(sides):4} from the side")


if __name__ == "__main__":
    main()
