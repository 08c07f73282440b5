"""`dexgrasp plan`: one grasp (or several) with its certificate, or the reason why there is none."""

import argparse
import os
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dexgrasp.cli.options import add_json, add_mesh, add_scene, add_seed, check_mesh_options
from dexgrasp.cli.plan_cloud import add_cloud, plan_scan, read_cloud
from dexgrasp.cli.plan_many import add_count, bar, check_count, describe_set, write_set

if TYPE_CHECKING:
    from dexgrasp.planning.look import Look
    from dexgrasp.planning.result import PlanResult, Progress

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
    from dexgrasp_env.files import jsonable

    if args.count is not None:
        check_count(args)
    scan = read_cloud(args) if args.cloud is not None else None
    if scan is None:
        _check_named(args)
    if args.out is not None:
        make_folder(args.out)
    say_when_compiling()
    with bar() if args.count is not None else nullcontext() as progress:
        found, content = _plan(args, progress) if scan is None else plan_scan(args, scan, progress)
    if args.out is not None and (found.success or args.count is not None):
        note(write_results(args.out, found, content))
    print_json(jsonable(content)) if args.json else print(describe(content, found.sentence))
    return 0 if found.success else 1


def _check_named(args: argparse.Namespace) -> None:
    """Let a mistake in the names show before anything heavy is imported, which takes a second."""
    from dexgrasp_env.errors import InputError

    if args.target is None:
        raise InputError(
            "name a TARGET: an object (see `dexgrasp list objects`), a mesh file, or --cloud FILE"
        )
    if args.mass is not None or args.object_near is not None:
        raise InputError(
            "--mass and --object-near are of --cloud: of a TARGET the planner is told nothing (--mesh-mass is a mesh's)"
        )
    check_target(args.target, args)


def _plan(args: argparse.Namespace, progress: "Progress | None") -> "tuple[PlanResult, dict[str, Any]]":
    """Plan for a named object; return what came of it, and the same as JSON."""
    look, found = plan_target(args, args.agent, args.count, progress)
    return found, found.as_json(look.subject.identity, args.agent, look.subject.pose)


def plan_target(
    args: argparse.Namespace, agent_name: str, count: int | None = None, progress: "Progress | None" = None
) -> "tuple[Look, PlanResult]":
    """Let an agent look at the object that is named, and plan.

    Raises:
        InputError: for an unknown agent, or one that plans no grasps.
    """
    _import_mujoco()
    from dexgrasp.planning.look import look_at
    from dexgrasp.planning.result import PlansGrasps
    from dexgrasp.registry import agent_for
    from dexgrasp_env.errors import InputError

    agent = agent_for(agent_name, args.friction)
    if not isinstance(agent, PlansGrasps):
        raise InputError(
            f"agent {agent_name!r} makes no certified plans: valid are bilevel, cvae, cvae_kinematics"
        )
    look = look_at(args.target, agent, args.seed, **scene_settings(args))
    return look, agent.plan(look.observation, look.info, count, progress)


def _import_mujoco() -> None:
    """Import MuJoCo without the window library that it would bring; what draws chooses its own, see `rendering`."""
    if "mujoco" not in sys.modules:  # MUJOCO_GL was put aside
        os.environ["MUJOCO_GL"] = "disable"
        import mujoco  # noqa: F401

        del os.environ["MUJOCO_GL"]


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
    for key, name in (("robot", "cell"), ("mount", "mount"), ("friction", "friction")):
        if getattr(args, name) is not None:
            settings[key] = getattr(args, name)
    return settings


def write_results(folder: Path, found: "PlanResult", content: dict[str, Any]) -> str:
    """Write grasp.json and grasp.png, or the files of a set; return a line that says so."""
    from dexgrasp.grasp.file import write_grasp
    from dexgrasp.grasp.picture import grasp_picture

    if found.asked is not None:
        return write_set(folder, content)
    write_grasp(folder / "grasp.json", content["grasp"])
    if found.grasp is not None and found.target is not None:
        title = f"{content['object']}: planned from what was seen"
        grasp_picture(folder / "grasp.png", found.grasp, found.target, title)
    return f"wrote {folder / 'grasp.json'} and {folder / 'grasp.png'}"


def describe(result: dict[str, Any], unseen: str = "") -> str:
    """Return the outcome as people read it; `unseen` says why no object was."""
    from dexgrasp.cli.output import coloured
    from dexgrasp.evaluation.reasons import explain

    if "asked" in result:
        return describe_set(result)
    if unseen:
        return f"{result['object']}: no object [{result['reason']}]\n  {unseen}"
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
