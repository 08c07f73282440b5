"""`dexgrasp verify`: every constraint of a grasp checked again, independently of the planner."""

import argparse
from pathlib import Path

from agents.cli.options import add_json

_EPILOG = """examples:
  dexgrasp plan pear --out grasps/pear && dexgrasp verify grasps/pear/grasp.json

Another way than the planner's: MuJoCo's kinematics and collision shapes, exact distances to the mesh, a conic solver on
the exact friction cones. Exit code 0 only if all checks hold, 1 otherwise."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "verify", help="check every constraint of a grasp again, independently", epilog=_EPILOG,
        description="Check a grasp file as `dexgrasp plan --out` writes it.",
    )  # fmt: skip
    parser.add_argument(
        "grasp", type=Path, metavar="GRASP.json", help="a grasp file, or the output of `plan --json`"
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Verify and print every check."""
    from dataclasses import asdict

    from agents.cli.output import print_json
    from agents.grasp.file import read_grasp
    from agents.grasp.verify import verify

    record = read_grasp(args.grasp)
    checks = verify(record)
    good = all(check.holds for check in checks)
    if args.json:
        print_json(
            {
                "schema": 1,
                "object": record.object,
                "holds": good,
                "checks": [asdict(check) for check in checks],
            }
        )
    else:
        width = max(len(check.name) for check in checks)
        for check in checks:
            mark = "ok  " if check.holds else "FAIL"
            print(f"{mark}  {check.name:<{width}}  {check.value:12.3e}   {check.bound}")
        print(f"{record.object}: " + ("every constraint holds" if good else "NOT verified"))
    return 0 if good else 1
