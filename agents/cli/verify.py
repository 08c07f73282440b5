"""`dexgrasp verify`: every constraint of a grasp checked again, independently of the planner."""

import argparse
from pathlib import Path
from typing import Any

from agents.cli.options import add_cell, add_json

_EPILOG = """examples:
  dexgrasp plan pear --out grasps/pear && dexgrasp verify grasps/pear/grasp.json

Another way than the planner's: MuJoCo's kinematics and collision shapes, exact distances to the mesh, conic and linear
solvers. Every field of the file is computed again or held to what it must be: docs/grasp-file.md. Exit code 0 only if
all checks hold, 1 otherwise; 1 as well for files of 0.1.0 (schema 1), of which not everything can be checked."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "verify", help="check every constraint of a grasp again, independently", epilog=_EPILOG,
        description="Check a grasp file as `dexgrasp plan --out` writes it.",
    )  # fmt: skip
    parser.add_argument(
        "grasp", type=Path, metavar="GRASP.json", help="a grasp file, or the output of `plan --json`"
    )
    add_cell(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Verify and print every check."""
    from dataclasses import asdict

    from agents.cli.output import mark, print_json
    from agents.grasp.file import read_grasp
    from agents.grasp.verify import unchecked, verify

    record = read_grasp(args.grasp)
    checks = verify(record)
    good = all(check.holds for check in checks) and not unchecked(record)
    if args.json:
        print_json({
            "schema": 1, "object": record.object.name, "holds": good, "not_checked": unchecked(record),
            "checks": [asdict(check) for check in checks],
        })  # fmt: skip
        return 0 if good else 1
    width = max(len(check.name) for check in checks)
    for check in checks:
        print(f"{mark(check.holds)}  {check.name:<{width}}  {check.value:12.3e}   {check.bound}")
    print(f"{record.object.name}: {_answer(checks, unchecked(record))}")
    return 0 if good else 1


def _answer(checks: list[Any], lacking: list[str]) -> str:
    failed = [check.name for check in checks if not check.holds]
    if failed:
        return f"NOT verified: {', '.join(failed)}"
    if lacking:
        return f"NOT verified: a file of schema 1 has nothing to check {', '.join(lacking)} by; plan it again"
    return "every constraint holds"
