"""What every grasp file states in the same words: frame, units, phases without a certificate, cell and robot."""

from dataclasses import dataclass

from dexgrasp_env.arrays import Fields
from dexgrasp_env.robot.cell import Cell


@dataclass(frozen=True)
class RobotName:
    """A robot by its name, and a hash of all that its files say."""

    name: str
    hash: str


def conventions(cell: Cell) -> Fields:
    """Return what a grasp file states for a cell, by field."""
    return {
        "frame": "robot_base",
        "units": {"length": "m", "angle": "rad", "force": "N", "mass": "kg", "time": "s"},
        # These run on feedback from the joints, so that no certificate can cover them.
        "outside_certificate": ["close", "hold"],
        "cell": cell.name,
        "robot": RobotName(cell.robot.name, cell.robot.hash),
        "table_height": cell.table_height,
        "joint_names": list(cell.robot.joints),
    }
