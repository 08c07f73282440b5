"""What every grasp file states in the same words: frame, units, phases without a certificate, cell and robot."""

from collections.abc import Mapping
from typing import Any

from dexgrasp_env.robot.active import of_process
from dexgrasp_env.robot.cell import Cell

STATED = ("frame", "units", "outside_certificate", "cell", "robot", "table_height", "joint_names")


def conventions(cell: Cell | str | None = None) -> dict[str, Any]:
    """Return what a grasp file states for a cell, or for the process's with a mount of that name."""
    cell = of_process(cell)
    return {
        "frame": "robot_base",
        "units": {"length": "m", "angle": "rad", "force": "N", "mass": "kg", "time": "s"},
        # These run on feedback from the joints, so that no certificate can cover them.
        "outside_certificate": ["close", "hold"],
        "cell": cell.name,
        "robot": {"name": cell.robot.name, "hash": cell.robot.hash},
        "table_height": cell.table_height,
        "joint_names": list(cell.robot.joints),
    }


def place(stated: Mapping[str, Any]) -> str:
    """Return where a file is for, in words: cell, robot, and the height of the table."""
    robot = stated["robot"]
    return f"{stated['cell']!r} ({robot['name']}-{robot['hash']}, table at {stated['table_height']:g} m)"
