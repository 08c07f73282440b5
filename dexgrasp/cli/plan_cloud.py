"""`dexgrasp plan --cloud`: a grasp of an object in a point cloud of one's own."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dexgrasp.cli.options import positive_float

if TYPE_CHECKING:
    from dexgrasp.planning.from_cloud import CloudPlan


def add_cloud(parser: argparse.ArgumentParser) -> None:
    """Add the options of clouds."""
    group = parser.add_argument_group("your own scene, instead of TARGET")
    group.add_argument(
        "--cloud", type=Path, metavar="FILE",
        help="ply, pcd, npy or npz in the robot base frame, metres; or a folder with cameras.yaml and depth images",
    )  # fmt: skip
    group.add_argument(
        "--object-near",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="a point near the object that is meant, m",
    )
    group.add_argument("--mass", type=positive_float, metavar="KG", help="of the object, where it is known")


def run_cloud(args: argparse.Namespace) -> int:
    """Plan on a cloud, print, and write what was asked for."""
    from dexgrasp.cli.output import make_folder, note, print_json, say_when_compiling
    from dexgrasp.cli.plan import describe, finish_set
    from dexgrasp.cli.plan_many import bar, check
    from dexgrasp.planning.from_cloud import default_planner, plan_cloud
    from dexgrasp_env.errors import InputError
    from dexgrasp_env.files import jsonable
    from dexgrasp_env.perception.scan import read_scan

    if args.target is not None:
        raise InputError("give a TARGET or --cloud, not both")
    if args.agent != "bilevel" or args.mesh_mass is not None or args.mesh_scale not in (None, 1.0):
        raise InputError("--agent, --mesh-scale and --mesh-mass do not apply to --cloud (its mass is --mass)")
    if args.count is not None:
        check(args)
    scene = read_scan(args.cloud)
    if args.out is not None:
        make_folder(args.out)
    say_when_compiling()
    planner = default_planner(args.mount or "palm_normal", args.friction)
    options = {"near": args.object_near, "mass": args.mass, "seed": args.seed, "planner": planner}
    if args.count is not None:
        with bar() as progress:
            many = plan_cloud(scene, count=args.count, progress=progress, **options)
        return finish_set(args, many.as_json(scan_name(args.cloud)))
    found = plan_cloud(scene, **options)
    result = found.as_json(scan_name(args.cloud))
    if args.out is not None and result["success"]:
        _write(args.out, found, result)
        note(f"wrote {args.out / 'grasp.json'} and {args.out / 'grasp.png'}")
    if args.json:
        print_json(jsonable(result))
    elif found.seen.reason is not None:
        print(f"{result['object']}: no object [{found.reason}]\n  {found.sentence}")
    else:
        print(describe(result))
    return 0 if result["success"] else 1


def scan_name(path: Path) -> str:
    """Return what a scan is called: a file without its suffix, a folder whole (`scan0.08` has none)."""
    return path.resolve().name if path.is_dir() else path.stem


def _write(folder: Path, found: "CloudPlan", result: dict[str, Any]) -> None:
    from dexgrasp.grasp.file import write_grasp
    from dexgrasp.grasp.picture import grasp_picture

    write_grasp(folder / "grasp.json", result["grasp"])
    if found.grasp is not None and found.target is not None:
        title = f"{result['object']}: planned from a cloud"
        grasp_picture(folder / "grasp.png", found.grasp, found.target, title)
