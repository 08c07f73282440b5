"""`dexgrasp dataset`: the grasp dataset of section 1.3, made and looked at."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dexgrasp.cli.options import (
    add_cell,
    add_jobs,
    add_json,
    add_mesh,
    add_seed,
    backend_of,
    check_mesh_options,
    positive_int,
)

_EPILOG = """examples:
  dexgrasp dataset generate --objects ycb6 --grasps-per-pose 3600 --out runs/ycb6 --workers 2
  dexgrasp dataset generate --objects scan.stl --mesh-scale 0.001 --grasps-per-pose 500 --out runs/scan
  dexgrasp dataset info runs/ycb6 --picture runs/ycb6.png --verify 500

A run that was interrupted goes on when the same command is given again; the files do not depend on --workers."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "dataset", help="make and look at the grasp dataset", epilog=_EPILOG,
        description="The grasp dataset: rest poses, contact triples in closure, hand configurations that reach them.",
    )  # fmt: skip
    commands = parser.add_subparsers(
        title="commands", metavar="COMMAND", dest="dataset_command", required=True
    )
    generate = commands.add_parser(
        "generate", help="make a dataset; resumable", epilog=_EPILOG,
        description="Make a dataset, rest pose by rest pose; what is there already is kept.",
    )  # fmt: skip
    _add_generate(generate)
    info = commands.add_parser(
        "info", help="counts, histograms, a picture",
        description="Say what a dataset holds, draw it, check some of it.",
    )  # fmt: skip
    info.add_argument("folder", type=Path, metavar="DIR", help="of the dataset")
    info.add_argument(
        "--picture", type=Path, metavar="PNG", help="where the picture goes (default DIR/dataset.png)"
    )
    info.add_argument(
        "--verify", type=positive_int, metavar="N", help="check N random grasps by independent means"
    )
    add_json(info)


def _add_generate(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--objects", nargs="+", required=True, metavar="OBJECT", help="objects, sets or mesh files"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the dataset")
    parser.add_argument(
        "--grasps-per-pose",
        type=positive_int,
        default=200,
        metavar="N",
        help="asked for of each rest pose (default 200)",
    )
    add_seed(parser)
    parser.add_argument(
        "--chunk", type=positive_int, default=200, metavar="N", help="grasps a file (default 200)"
    )
    parser.add_argument(
        "--tries",
        type=positive_int,
        default=12,
        metavar="N",
        help="postures tried for a grasp asked for (default 12)",
    )
    add_jobs(parser)
    add_mesh(parser)
    add_cell(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Run `generate` or `info`."""
    return _generate(args) if args.dataset_command == "generate" else _info(args)


def _generate(args: argparse.Namespace) -> int:
    from dexgrasp.cli.output import resumable
    from dexgrasp.dataset.generate import generate
    from dexgrasp.dataset.info import summary
    from dexgrasp.dataset.settings import DatasetSettings
    from dexgrasp.runs.progress import progress_bar

    backend = backend_of(args)
    settings = DatasetSettings.of(
        args.objects, grasps_per_pose=args.grasps_per_pose, seed=args.seed, chunk=args.chunk, tries=args.tries,
        mesh_scale=args.mesh_scale, mesh_mass=args.mesh_mass, robot=args.cell,
    )  # fmt: skip
    check_mesh_options(args, settings.objects)
    with resumable(f"finished files are kept in {args.out}"), progress_bar("file", "dataset") as bar:
        generate(settings, args.out, backend, bar)
    return _print(args, summary(args.out))


def _info(args: argparse.Namespace) -> int:
    from dexgrasp.dataset.info import check_sample, picture, summary

    figures = summary(args.folder)
    path = args.picture or args.folder / "dataset.png"
    picture(args.folder, path)
    figures["picture"] = str(path)
    code = 0
    if args.verify:
        figures["verify"] = check_sample(args.folder, args.verify)
        code = int(figures["verify"]["passed"] < figures["verify"]["checked"])
    _print(args, figures)
    return code


def _print(args: argparse.Namespace, figures: dict[str, Any]) -> int:
    from dexgrasp.cli.output import print_json
    from dexgrasp.runs.text import text_table

    if args.json:
        print_json(figures)
        return 0
    rows = [
        [
            p["object"],
            str(p["pose"]),
            f"{p['probability']:.2f}",
            str(p["grasps"]),
            str(p["triples_feasible"]),
            f"{p['coverage']:.0%}",
        ]
        for p in figures["poses"]
    ]
    print(text_table(["object", "pose", "probability", "grasps", "triples", "coverage"], rows))
    print("\n" + "\n\n".join(describe(figures)))
    return 0


def describe(figures: Mapping[str, Any]) -> list[str]:
    """Return the figures of a dataset as tables: the loose ones, what postures came to, what blocked, distributions."""
    from dexgrasp.cli.benchmark import shown
    from dexgrasp.evaluation.reasons import sentence
    from dexgrasp.runs.text import left_table, text_table

    loose = [
        [name.replace("_", " "), shown(v)] for name, v in figures.items() if not isinstance(v, dict | list)
    ]
    counts = [[name.replace("_", " "), str(count)] for name, count in figures.get("counts", {}).items()]
    blocked = [[str(count), sentence(reason)] for reason, count in figures.get("blocked", {}).items()]
    spread = [
        [label, *(shown(figures[key].get(q)) for q in ("p10", "median", "p90"))]
        for key, label in (
            ("margin", "closure margin"),
            ("approach_degrees", "approach from straight down, deg"),
        )
        if figures.get(key)
    ]
    edges, bins = (figures.get("margin_histogram", {}).get(key, []) for key in ("edges", "counts"))
    histogram = [
        [f"{low:.2f} .. {high:.2f}", str(n)] for low, high, n in zip(edges, edges[1:], bins, strict=False)
    ]
    parts = [
        left_table(("figure", "value"), loose),
        text_table(("postures", "count"), counts) if counts else "",
        left_table(("count", "blocked because"), blocked) if blocked else "",
        text_table(("", "10 %", "median", "90 %"), spread) if spread else "",
        text_table(("closure margin", "grasps"), histogram) if histogram else "",
    ]
    if "verify" in figures:
        checked = figures["verify"]
        rows = [["passed", f"{checked['passed']} of {checked['checked']}"]]
        rows += [[name, str(n)] for name, n in checked["failures"].items()]
        parts.append(text_table(("verify", "count"), rows))
    return [part for part in parts if part]
