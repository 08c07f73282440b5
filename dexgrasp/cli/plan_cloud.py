"""`dexgrasp plan --cloud`: a grasp of an object in a point cloud of one's own."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dexgrasp.cli.options import positive_float

if TYPE_CHECKING:
    from dexgrasp.planning.result import PlanResult, Progress
    from dexgrasp_env.perception.cloud import Cloud


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


def read_cloud(args: argparse.Namespace) -> "Cloud":
    """Check the options that go with a cloud, and read it."""
    from dexgrasp_env.errors import InputError
    from dexgrasp_env.perception.scan import read_scan

    if args.target is not None:
        raise InputError("give a TARGET or --cloud, not both")
    if args.agent != "bilevel" or args.mesh_mass is not None or args.mesh_scale not in (None, 1.0):
        raise InputError("--agent, --mesh-scale and --mesh-mass do not apply to --cloud (its mass is --mass)")
    return read_scan(args.cloud)


def plan_scan(
    args: argparse.Namespace, scan: "Cloud", progress: "Progress | None"
) -> "tuple[PlanResult, dict[str, Any]]":
    """Plan on a cloud; return what came of it, and the same as JSON."""
    from dexgrasp.planning.from_cloud import default_planner, scene_of
    from dexgrasp.planning.seen import plan_scene
    from dexgrasp_env.robot.cell import make_cell

    planner = default_planner(make_cell(args.cell, args.mount), args.friction)
    scene = scene_of(scan, near=args.object_near, seed=args.seed, cell=planner.cell)
    home = planner.cell.robot.home
    found = plan_scene(planner, scene, args.seed, home, mass=args.mass, count=args.count, progress=progress)
    return found, found.as_json(scan_name(args.cloud))


def scan_name(path: Path) -> str:
    """Return what a scan is called: a file without its suffix, a folder whole (`scan0.08` has none)."""
    return path.resolve().name if path.is_dir() else path.stem
