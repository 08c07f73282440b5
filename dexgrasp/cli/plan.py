"""`dexgrasp plan`: one grasp (or several) with its certificate, or the reason why there is none."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from dexgrasp.cli.options import add_json, add_mesh, add_scene, add_seed, check_mesh_options
from dexgrasp.cli.plan_cloud import add_cloud, run_cloud
from dexgrasp.cli.plan_many import add_count, bar, check, describe_set, write_set

_EPILOG = """examples:
  dexgrasp plan sugar_box                             a box of the catalogue, as four depth cameras see it
  dexgrasp plan my_part.stl --mesh-scale 0.001        your own mesh, drawn in millimetres
  dexgrasp plan pear --seed 3 --out grasps/pear       writes grasp.json and grasp.png
  dexgrasp plan pear --json | jq .certificate
  dexgrasp plan --cloud scene.ply --out out/scene     your own point cloud, in the robot base frame, metres
  dexgrasp plan pear --count 20 --out grasps/pear     20 grasps that differ: grasp_000.json is the firmest
  dexgrasp plan pear --friction 0.35                  a slippery one, and a planner that knows it: it counts on 5/7
                                                      of MU for closure, 6/7 for the forces (never over 0.5 and 0.6)

The object is put on the table in a pose drawn from --seed, seen with the default sensor noise, and planned for without
knowledge of its pose or mass. Exit code 1 says that there is no grasp; the reason is printed."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "plan", help="one grasp with its certificate, or the reason why there is none", epilog=_EPILOG,
        description="Plan one grasp of an object on the table, or K that differ.",
    )  # fmt: skip
    parser.add_argument(
        "target",
        metavar="TARGET",
        nargs="?",
        help="object of the catalogue or mesh file (obj, stl, ply, glb)",
    )
    add_cloud(parser)
    parser.add_argument("--agent", default="bilevel", metavar="NAME", help="which planner (default bilevel)")
    add_seed(parser, "of scene and planner")
    add_count(parser)
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for grasp.json and grasp.png")
    add_mesh(parser)
    add_scene(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Plan, print, and write what was asked for."""
    from dexgrasp.cli.output import make_folder, note, print_json, say_when_compiling
    from dexgrasp_env.errors import InputError
    from dexgrasp_env.files import jsonable

    if args.cloud is not None:
        return run_cloud(args)
    if args.target is None:
        raise InputError(
            "name a TARGET: an object (see `dexgrasp list objects`), a mesh file, or --cloud FILE"
        )
    if args.mass is not None or args.object_near is not None:
        raise InputError(
            "--mass and --object-near are of --cloud: of a TARGET the planner is told nothing (--mesh-mass is a mesh's)"
        )
    check_target(args.target, args)
    if args.count is not None:
        check(args)
    if args.out is not None:
        make_folder(args.out)
    say_when_compiling()
    _import_mujoco()
    if args.count is not None:
        return _run_many(args)
    from dexgrasp.planning.attempt import plan_target  # mistakes are told before this, which takes a second

    attempt = plan_target(args.target, args.agent, args.seed, **scene_settings(args))
    result = attempt.as_json()
    if args.out is not None and result["success"]:
        write_results(args.out, attempt, result)
        note(f"wrote {args.out / 'grasp.json'} and {args.out / 'grasp.png'}")
    if args.json:
        print_json(jsonable(result))
    else:
        print(describe(result))
    return 0 if result["success"] else 1


def _import_mujoco() -> None:
    """Import MuJoCo without the window library that it would bring; what draws chooses its own, see `rendering`."""
    if "mujoco" not in sys.modules:  # MUJOCO_GL was put aside
        os.environ["MUJOCO_GL"] = "disable"
        import mujoco  # noqa: F401

        del os.environ["MUJOCO_GL"]


def _run_many(args: argparse.Namespace) -> int:
    from dexgrasp.planning.attempt_set import plan_target_set

    with bar() as progress:
        found = plan_target_set(
            args.target, args.count, args.agent, args.seed, progress, **scene_settings(args)
        )
    return finish_set(args, found.as_json())


def finish_set(args: argparse.Namespace, result: dict[str, Any]) -> int:
    """Write and print a set of grasps; return the exit code."""
    from dexgrasp.cli.output import note, print_json
    from dexgrasp_env.files import jsonable

    if args.out is not None:
        note(write_set(args.out, result))
    if args.json:
        print_json(jsonable(result))
    else:
        print(describe_set(result))
    return 0 if result["success"] else 1


def check_target(target: str, args: argparse.Namespace) -> None:
    """Let a mistake in the names show before anything heavy is imported.

    Raises:
        InputError: for an unknown object or agent, a set, or options that do not apply to the object.
    """
    from dexgrasp.registry import check_name
    from dexgrasp_env.errors import InputError
    from dexgrasp_env.objects.load import resolve_targets

    found = resolve_targets([target])
    if len(found) > 1:
        raise InputError(f"{target!r} is a set: name one of its objects ({', '.join(found)})")
    check_mesh_options(args, found)
    check_name(args.agent)


def scene_settings(args: argparse.Namespace) -> dict[str, Any]:
    """Return the environment's arguments that the options name."""
    settings = {"mesh_scale": args.mesh_scale, "mesh_mass": args.mesh_mass}
    for key in ("mount", "friction"):
        if getattr(args, key) is not None:
            settings[key] = getattr(args, key)
    return settings


def write_results(folder: Path, attempt: Any, result: dict[str, Any]) -> None:
    """Write grasp.json and grasp.png."""
    from dexgrasp.grasp.file import write_grasp
    from dexgrasp.grasp.picture import grasp_picture

    write_grasp(folder / "grasp.json", result["grasp"])
    grasp_picture(
        folder / "grasp.png",
        attempt.grasp,
        attempt.grasp_target,
        f"{attempt.name}: planned from what was seen",
    )


def describe(result: dict[str, Any]) -> str:
    """Return the outcome as people read it."""
    from dexgrasp.cli.output import coloured
    from dexgrasp.evaluation.reasons import explain

    head = f"{result['object']}: "
    seconds = f"{1000 * (result['planning_seconds'] or 0.0):.0f} ms"
    if not result["success"]:
        why = explain(result["reason"], result["blocked"], result["violations"])
        return f"{head}{coloured('no grasp', 'bad')} after {seconds} [{result['reason']}]\n  {why}"
    certificate = result["certificate"]
    found = coloured("grasp found", "good")
    if not certificate["holds"]:
        found = coloured("grasp found that does not bear the assumed weight", "look")
    lines = [f"{head}{found} in {seconds}"]
    rows = {
        "fingertip distances, cm (allowed -0.68 .. -0.32)": " ".join(
            f"{d:.2f}" for d in certificate["distances_cm"]
        ),
        "closure margin (0 edge, 1 best)": f"{certificate['closure_margin']:.2f}",
        "force ratio, %": f"{certificate['force_ratio_percent']:.1e}",
        "torque ratio, %": f"{certificate['torque_ratio_percent']:.1e}",
        "least clearance, mm": f"{1000 * certificate['min_clearance_m']:.1f}",
        "distance to a joint limit, rad": f"{certificate['joint_limit_margin_rad']:.3f}",
        "joint torque over its limit": f"{certificate['max_joint_torque_fraction']:.2f}",
        "load (1: bears its weight, 2: and a push as large)": f"{certificate['load']:.2f}",
        "capacity (the same of any forces within the torques)": f"{certificate['capacity']:.2f}",
        "holds": f"{certificate['holds']} (assumed to weigh {1000 * certificate['mass']:.0f} g)",
    }
    width = max(map(len, rows))
    return "\n".join(lines + [f"  {name:<{width}}  {value}" for name, value in rows.items()])
