"""`dexgrasp verify`: every constraint of a grasp checked again, independently of the planner."""

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dexgrasp.cli.options import add_cell, add_json
from dexgrasp.cli.output import mark, print_json

if TYPE_CHECKING:
    from dexgrasp.grasp.record import GraspRecord
    from dexgrasp.verify.check import Check

_EPILOG = """examples:
  dexgrasp plan pear --out grasps/pear && dexgrasp verify grasps/pear/grasp.json
  dexgrasp plan pear --count 20 --out grasps/pear && dexgrasp verify grasps/pear/grasp_*.json

Another way than the planner's: MuJoCo's kinematics and collision shapes, exact distances to the mesh, cone
programmes. Every field of the file is computed again or held to what it must be: docs/grasp-file.md. Exit code 0 only
if all checks of all files hold, 1 otherwise."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "verify", help="check every constraint of a grasp again, independently", epilog=_EPILOG,
        description="Check grasp files as `dexgrasp plan --out` writes them.",
    )  # fmt: skip
    parser.add_argument(
        "grasps",
        type=Path,
        nargs="+",
        metavar="GRASP.json",
        help="grasp files, or the output of `plan --json`",
    )
    add_cell(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Verify and print every check; of several files what came of each."""
    from dexgrasp.grasp.file import read_grasp
    from dexgrasp.verify.verify import verify
    from dexgrasp_env.robot.cell import make_cell

    cell = make_cell(args.cell)
    records = [read_grasp(path, cell) for path in args.grasps]
    found = [_finding(record, verify(record)) for record in records]
    good = all(one["holds"] for one in found)
    if args.json:
        each = [{"file": str(path)} | one for path, one in zip(args.grasps, found, strict=True)]
        print_json({"schema": 1} | (found[0] if len(found) == 1 else {"holds": good, "grasps": each}))
    elif len(found) == 1:
        _print_checks(found[0])
    else:
        for path, one in zip(args.grasps, found, strict=True):
            print(f"{mark(one['holds'])}  {path}: {_answer(one)}")
        print(f"{sum(one['holds'] for one in found)} of {len(found)} grasps hold every constraint")
    return 0 if good else 1


def _finding(record: "GraspRecord", checks: "list[Check]") -> dict[str, Any]:
    """What `--json` prints of a grasp."""
    return {
        "object": record.object.name,
        "holds": all(check.holds for check in checks),
        "checks": [asdict(check) for check in checks],
    }


def _print_checks(found: dict[str, Any]) -> None:
    width = max(len(check["name"]) for check in found["checks"])
    for check in found["checks"]:
        print(f"{mark(check['holds'])}  {check['name']:<{width}}  {check['value']:12.3e}   {check['bound']}")
    print(f"{found['object']}: {_answer(found)}")


def _answer(found: dict[str, Any]) -> str:
    failed = [check["name"] for check in found["checks"] if not check["holds"]]
    if failed:
        return f"NOT verified: {', '.join(failed)}"
    return "every constraint holds"
