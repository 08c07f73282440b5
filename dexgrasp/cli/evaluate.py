"""`dexgrasp evaluate`: rollouts of several agents under the same protocols."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from dexgrasp.cli.options import (
    add_film,
    add_jobs,
    add_json,
    add_mesh,
    add_scene,
    add_seed,
    backend_of,
    check_mesh_options,
    natural_int,
    positive_int,
    share,
)
from dexgrasp.runs import interrupt

if TYPE_CHECKING:
    from dexgrasp.evaluation.settings import EvaluationSettings

_EPILOG = """examples:
  dexgrasp evaluate --agents random hardcoded --objects seen familiar --trials 3 --seed 0
  dexgrasp evaluate --agents bilevel --objects all20 --trials 6 --workers 8 --out runs/tables
  dexgrasp evaluate --agents my_package.policies:MyPolicy --objects sugar_box --video 1
  dexgrasp evaluate --agents bilevel --objects all20 --trials 6 --out runs/tables --video failures
  dexgrasp evaluate --agents bilevel --objects scan.stl --mesh-scale 0.001 --mesh-mass 0.3
  dexgrasp evaluate --agents bilevel hardcoded --objects all20 --power 0.05      how many trials would it take?
  dexgrasp evaluate --agents bilevel hardcoded --objects all20 --trials 50 --stop-early

Every agent meets the same scenes: trial k of an object depends on --seed, the object and k alone. A run that was
interrupted goes on when the same command is given again; other code, meshes or checkpoints are another evaluation. The
folder of --out then holds trials.jsonl (a line a trial, with all that `dexgrasp replay` needs to make it again),
summary.json (as --json prints it), run.json (the settings), grasps/ and videos/.

NB: package.module:Class runs that module. Checkpoints (.zip) are read without running anything pickled in them."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "evaluate", help="rollouts of agents under the same protocols; resumable", epilog=_EPILOG,
        description="Score agents on objects: success rates with intervals, failure reasons, planning times.",
    )  # fmt: skip
    parser.add_argument(
        "--agents",
        nargs="+",
        required=True,
        metavar="AGENT",
        help="names (dexgrasp list agents), checkpoints, or package.module:Class",
    )
    parser.add_argument(
        "--objects",
        nargs="+",
        required=True,
        metavar="OBJECT",
        help="objects, sets (dexgrasp list objects), or mesh files",
    )
    parser.add_argument(
        "--trials", type=positive_int, default=3, metavar="N", help="of each agent on each object (default 3)"
    )
    add_seed(parser, "of all scenes")
    parser.add_argument(
        "--protocol", nargs="+", default=["lift"], metavar="P",
        help="how to score: see dexgrasp list protocols (default lift)",
    )  # fmt: skip
    add_jobs(parser)
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the results (default runs/<from the settings>)"
    )
    parser.add_argument(
        "--video",
        type=_videos,
        default=0,
        metavar="K|failures",
        help="record the first K trials of every agent and object, or those that failed; also of a finished run",
    )
    add_film(parser)
    add_statistics(parser)
    add_scene(parser)
    add_mesh(parser)
    add_json(parser)


def _videos(text: str) -> "int | str":
    return text if text == "failures" else natural_int(text)


def add_statistics(parser: argparse.ArgumentParser) -> None:
    """Add `--power`, `--expect` and `--stop-early`."""
    group = parser.add_argument_group("statistics")
    group.add_argument(
        "--power", type=share, metavar="DIFF",
        help="run nothing: say how many trials it takes to see a difference of DIFF (0.05: five points)",
    )  # fmt: skip
    group.add_argument(
        "--expect", type=share, default=0.95, metavar="RATE",
        help="with --power: the better agent's rate (default 0.95)",
    )  # fmt: skip
    group.add_argument(
        "--stop-early", type=share, metavar="LEVEL", nargs="?", const=0.05,
        help="stop once all agents are told apart; equals are called different with a chance of at most LEVEL "
        "(default 0.05), however often one looks",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Evaluate, print tables or JSON; 3 if a worker died, with what was finished kept."""
    from dexgrasp.cli.output import note
    from dexgrasp.evaluation.evaluate import LostTrialsError, evaluate
    from dexgrasp.evaluation.settings import EvaluationSettings
    from dexgrasp.evaluation.video import Film
    from dexgrasp.registry import check_name
    from dexgrasp.runs.pool import WorkerDiedError

    backend = backend_of(args)
    settings = EvaluationSettings.of(
        args.agents, args.objects, trials=args.trials, seed=args.seed, protocols=tuple(args.protocol), robot=args.cell,
        mount=args.mount,
        friction=args.friction, mesh_scale=args.mesh_scale, mesh_mass=args.mesh_mass,
    )  # fmt: skip
    check_mesh_options(args, settings.objects)
    if args.power is not None:
        return _print_power(args, settings)
    for agent in settings.agents:
        check_name(agent)
    folder = args.out or settings.default_folder()
    note(f"results go to {folder}")
    try:
        evaluate(
            settings,
            folder,
            backend=backend,
            videos=args.video,
            film=Film(args.camera, args.size),
            stop_level=args.stop_early,
        )
    except (KeyboardInterrupt, WorkerDiedError) as stop:
        interrupt.acknowledge()
        what = str(stop) or "interrupted"
        note(
            f"dexgrasp evaluate: {what}; finished trials are kept in {folder}: the same command goes on from there"
        )
        return _print(args, folder, code=3)
    except LostTrialsError as lost:
        note(f"dexgrasp evaluate: {lost}; the others are in {folder}")
        return _print(args, folder, code=1)
    return _print(args, folder, code=0)


def _print_power(args: argparse.Namespace, settings: "EvaluationSettings") -> int:
    from dexgrasp.cli.output import print_json
    from dexgrasp.evaluation.power import power_figures, power_sentences

    figures = power_figures(args.power, args.expect, len(settings.agents), len(settings.objects))
    if args.json:
        print_json({"schema": 1, "power": figures})
    else:
        print("\n".join(power_sentences(figures)))
    return 0


def _print(args: argparse.Namespace, folder: Path, code: int) -> int:
    import json

    from dexgrasp.cli.output import print_json
    from dexgrasp.evaluation.report.tables import render_summary

    path = folder / "summary.json"
    if path.is_file():
        summary = json.loads(path.read_text())
        if args.json:
            print_json(summary)
        else:
            print(render_summary(summary))
    return code
