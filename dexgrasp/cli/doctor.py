"""`dexgrasp doctor`: what works on this machine, and whether a mesh is fit to use."""

import argparse
from pathlib import Path

from dexgrasp.cli.options import add_json, positive_float
from dexgrasp_env.errors import InputError

_EPILOG = """examples:
  dexgrasp doctor                                    this machine
  dexgrasp doctor scan.stl other.obj                 and two meshes
  dexgrasp doctor part.stl --mesh-scale 0.001        a mesh in millimetres

exit codes: 0 all is well; 1 something has to be mended (the remedy is printed)"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "doctor", help="what works on this machine, and whether a mesh is fit to use", epilog=_EPILOG,
        description="Check versions, rendering, threads and the cache; check meshes and say what to do about them.",
    )  # fmt: skip
    parser.add_argument("meshes", nargs="*", type=Path, metavar="MESH", help="obj, stl, ply or glb files")
    parser.add_argument(
        "--mesh-scale", type=positive_float, default=1.0, metavar="F", help="factor to metres (default 1)"
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Print the findings; 1 if one of them is an error."""
    from dataclasses import asdict

    from dexgrasp.cli import checks
    from dexgrasp.cli.output import coloured, note, print_json

    for mesh in args.meshes:
        if not mesh.is_file():
            raise InputError(f"mesh file {str(mesh)!r} does not exist")
    note("checking this machine")
    found = {
        "versions": checks.check_versions(), "rendering": checks.check_rendering(), "machine": checks.check_machine(),
    }  # fmt: skip
    for mesh in args.meshes:
        note(f"checking {mesh} (a first look can take a minute)")
        found[str(mesh)] = checks.check_mesh(mesh, args.mesh_scale)
    wrong = any(finding.level == "error" for part in found.values() for finding in part)
    if args.json:
        content = {part: [asdict(finding) for finding in findings] for part, findings in found.items()}
        print_json({"schema": 1, "ok": not wrong, "findings": content})
    else:
        for part, findings in found.items():
            lines = (f"  {coloured(*_MARKS[f.level])} {f.problem}{_remedy(f)}" for f in findings)
            print("\n".join([part, *lines]))
    return 1 if wrong else 0


_MARKS = {"info": ("ok   ", "good"), "warning": ("look ", "look"), "error": ("WRONG", "bad")}


def _remedy(finding: object) -> str:
    remedy = getattr(finding, "remedy", "")
    return f" -> {remedy}" if remedy and remedy != "nothing to do" else ""
