"""`dexgrasp export`: a grasp as a trajectory that a robot's controllers take."""

import argparse
from pathlib import Path

from dexgrasp.cli.options import add_cell, add_json, positive_float

_EPILOG = """examples:
  dexgrasp plan pear --out grasps/pear
  dexgrasp export grasps/pear/grasp.json --format csv --out robot/pear && dexgrasp check robot/pear
  dexgrasp export grasps/pear/grasp.json --format mjcf --out robot/pear && dexgrasp check robot/pear --replay 20

csv: arm.csv (1 kHz), hand.csv (333 Hz), s and rad, and segments.json; json: all of it in trajectory.json; ros2:
arm.yaml and hand.yaml (trajectory_msgs/JointTrajectory: every tenth row of the arm's csv, every fifth of the hand's),
grasp.yaml (moveit_msgs/Grasp), and the csv beside them; mjcf: scene.xml with its meshes, which loads by itself
anywhere, and the csv beside it. `dexgrasp check` reads csv and json. The arm stays within the maker's limits of
position, velocity, acceleration and jerk. The trajectory is open loop, and has never run on hardware: check it, try it
slowly."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "export", help="a grasp as a trajectory for a robot, or its scene as MJCF", epilog=_EPILOG,
        description="Write the trajectory of a grasp file, from the approach to the end of the lift.",
    )  # fmt: skip
    parser.add_argument(
        "grasp", type=Path, metavar="GRASP.json", help="a grasp file of `dexgrasp plan --out`"
    )
    parser.add_argument("--format", default="csv", metavar="F", help="csv (default), json, ros2 or mjcf")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the files")
    parser.add_argument(
        "--stiffness", type=positive_float, metavar="K",
        help="Nm/rad of the hand's servos, for the squeeze as position offsets (default: the cell's, 10)",
    )  # fmt: skip
    add_cell(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Export and name the files."""
    from dexgrasp.cli.output import make_folder, print_json
    from dexgrasp.export.grasp_export import export_grasp
    from dexgrasp.grasp.file import read_grasp
    from dexgrasp_env.robot.cell import make_cell

    record = read_grasp(args.grasp, make_cell(args.cell))
    files = export_grasp(record, make_folder(args.out), args.format, args.stiffness)
    if args.json:
        print_json({"schema": 1, "object": record.object.name, "files": [str(file) for file in files]})
    else:
        shown = [file for file in files if file.suffix != ".obj"]
        print("\n".join(f"wrote {file}" for file in shown))
        cell = f" --cell {args.cell}" if args.cell else ""
        print(f"check it before anything moves: dexgrasp check {args.out}{cell}")
    return 0
