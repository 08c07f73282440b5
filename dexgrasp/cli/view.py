"""`dexgrasp view`: a grasp in the browser, from approach to hold."""

import argparse
from pathlib import Path
from typing import Any

from dexgrasp.cli.options import add_json, add_mesh, add_scene, add_seed, positive_int

_EPILOG = """examples:
  dexgrasp view pear                                  plan, then look at it in the browser
  dexgrasp view grasps/pear/grasp.json --html pear.html
  dexgrasp view runs/tables                           grasps of an evaluation side by side

Shown are the robot, the object, the hull that was planned on, contacts, friction cones and forces. The motion is the
planned one, drawn without physics. The page of --html is self-contained; no GL library is needed here."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "view", help="a grasp in the browser, from approach to hold", epilog=_EPILOG,
        description="Look at a grasp: on a local server, or as one self-contained page.",
    )  # fmt: skip
    parser.add_argument(
        "target",
        metavar="TARGET|GRASP.json|RUN",
        help="an object to plan for, a grasp file, or an evaluation",
    )
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a page instead of serving one")
    add_seed(parser, "of scene and planner")
    parser.add_argument(
        "--port", type=positive_int, default=8080, metavar="P", help="of the server (default 8080)"
    )
    add_mesh(parser)
    add_scene(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Plan or read, then serve or write."""
    from dexgrasp.cli.output import make_folder, note, print_json
    from dexgrasp.viewer.page import page, serve
    from dexgrasp_env.files import write_atomically

    if args.html is not None:
        make_folder(args.html.parent)
    films = _films(args)
    if not films:
        return 1
    if args.html is None:
        note(f"showing {films[0].title} at http://127.0.0.1:{args.port} (Ctrl-C ends it)")
        serve(films, args.port)
        return 0
    write_atomically(args.html, page(films).encode())
    note(f"wrote {args.html}")
    if args.json:
        print_json({"schema": 1, "file": str(args.html), "films": [film.title for film in films]})
    return 0


def _films(args: argparse.Namespace) -> list[Any]:
    from dexgrasp.grasp.file import read_grasp
    from dexgrasp.viewer.from_record import film_of, films_of_run
    from dexgrasp_env.robot.cell import make_cell

    path = Path(args.target)
    if path.is_dir():
        return films_of_run(path, make_cell(args.cell))
    if path.suffix.lower() == ".json" and path.is_file():
        return [film_of(read_grasp(path, make_cell(args.cell)))]
    return _planned(args)


def _planned(args: argparse.Namespace) -> list[Any]:
    from dexgrasp.cli.output import note
    from dexgrasp.cli.plan import plan_target
    from dexgrasp.grasp.file import record_of
    from dexgrasp.viewer.from_record import film_of
    from dexgrasp_env.perception.scene import Scene
    from dexgrasp_env.robot.cell import make_cell

    look, found = plan_target(args, "bilevel")
    name, pose = look.subject
    if not found.success:
        note(f"{name.name}: no grasp ({found.reason}), so there is nothing to show")
        return []
    seen = Scene.of_observation(look.observation).target.points
    return [
        film_of(record_of(content, cell=make_cell(args.cell)), seen)
        for content in found.contents(name, "bilevel", pose)
    ]
