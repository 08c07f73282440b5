"""`dexgrasp replay`: one trial of an evaluation again, exactly."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from dexgrasp.cli.options import add_cell, add_film, add_json, natural_int

if TYPE_CHECKING:
    from dexgrasp.evaluation.replay import Replay

_EPILOG = """examples:
  dexgrasp replay runs/tables --agent bilevel --object mask --trial 2
  dexgrasp replay runs/tables --agent bilevel --object mask --trial 2 --video

The trial is made from the seeds and settings that its line in trials.jsonl holds, with the code that is here now.
Exit code 0 if it comes out as recorded, to the last bit of height, slip and tilt; 1 if not, with the differences."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "replay", help="one trial of an evaluation again, exactly", epilog=_EPILOG,
        description="Make a trial of an evaluation again, and record it.",
    )  # fmt: skip
    parser.add_argument("folder", type=Path, metavar="RUN", help="the --out of an evaluation")
    parser.add_argument("--agent", required=True, metavar="A", help="its name there")
    parser.add_argument("--object", required=True, metavar="O", help="its name there")
    parser.add_argument("--trial", required=True, type=natural_int, metavar="K", help="number, from 0 on")
    parser.add_argument("--protocol", metavar="P", help="where the evaluation has several")
    parser.add_argument("--video", action="store_true", help="record it, into videos/ of RUN")
    add_film(parser)
    add_cell(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Replay, say what is different."""
    from dexgrasp.cli.output import note, print_json
    from dexgrasp.evaluation.replay import replay
    from dexgrasp.evaluation.video import Film

    film = Film(args.camera, args.size) if args.video else None
    found = replay(
        args.folder, args.agent, args.object, args.trial, protocol=args.protocol, film=film, robot=args.cell
    )
    if found.stale:
        note(f"note: the evaluation was made with other {' and '.join(found.stale)}")
    if args.json:
        print_json(
            {
                "schema": 1,
                "same": not found.changed,
                "changed": list(found.changed),
                "stale": list(found.stale),
                "trial": found.again,
                "recorded": found.row,
                "grasp": found.grasp,
                "video": None if found.video is None else str(found.video),
            }
        )
    else:
        print(_sentences(args, found))
    return 1 if found.changed else 0


def _sentences(args: argparse.Namespace, found: "Replay") -> str:
    again, row, changed, video = found.again, found.row, found.changed, found.video
    outcome = "lifted and held" if again["success"] else f"failed: {again['reason']}"
    lines = [f"{args.agent} on {args.object}, trial {args.trial}: {outcome}, after {again['steps']} steps"]
    lines += [f"  {key}: {row[key]} there, {again[key]} now" for key in changed]
    lines.append("not as recorded" if changed else "as recorded, to the last bit")
    return "\n".join([*lines, *([] if video is None else [f"video: {video}"])])
