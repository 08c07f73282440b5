"""`dexgrasp score`: grasp files, ours or others', under published protocols."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dexgrasp.cli.options import add_cell, add_json, add_seed, positive_float, positive_int

_EPILOG = """examples:
  dexgrasp plan sugar_box --out grasps && dexgrasp score grasps/grasp.json --protocol dgb_fc dgb_tabletop
  dexgrasp score theirs/*.npy --mesh meshes/ --protocol dgb_fc          files of DexGraspBench or BODex
  dexgrasp score frogger/*.npz --mesh ycb/ --protocol frogger_pick get_a_grip --workers 2 --out scores
  dexgrasp score mine.json --hand my_hand.xml --protocol dgb_fc         a plain JSON, another hand

Reads our grasp files, .npy dictionaries, FRoGGeR-style .npz arrays and a plain JSON; nothing in a file is executed.
docs/scoring.md has formats, frames and what differs from the publications. The hand floats: no arm, no approach. Exit
code 1 if no grasp succeeds under any of the protocols. `dexgrasp list protocols` says what each asks for."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "score", help="grasp files, ours or others', under published protocols", epilog=_EPILOG,
        description="Score grasps of a floating hand: success by protocol with intervals, penetration, contacts.",
    )  # fmt: skip
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="grasp files: .json, .npy, .npz")
    parser.add_argument(
        "--protocol", nargs="+", default=["dgb_fc"], metavar="P",
        help="dgb_fc, dgb_tabletop, frogger_pick, get_a_grip, dro (default dgb_fc)",
    )  # fmt: skip
    parser.add_argument(
        "--mesh", nargs="+", type=Path, default=[], metavar="PATH",
        help="mesh files, or folders of them, for objects that the files only name",
    )  # fmt: skip
    parser.add_argument(
        "--mesh-scale", type=positive_float, default=1.0, metavar="F",
        help="factor from the meshes' unit to metres (default 1)",
    )  # fmt: skip
    parser.add_argument(
        "--hand",
        default="allegro",
        metavar="HAND",
        help="allegro, or the path of an MJCF hand (default allegro)",
    )
    add_seed(parser, "of the draws of pose noise")
    parser.add_argument(
        "--workers", type=positive_int, default=1, metavar="W",
        help="processes (default 1); the outcome does not depend on it",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write scores.json there, as --json prints it"
    )
    add_cell(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Score, print a table or JSON; 1 if nothing succeeded."""
    import json

    from dexgrasp.cli.output import note, print_json
    from dexgrasp.scoring.readers import ReadOptions
    from dexgrasp.scoring.score import score_files
    from dexgrasp_env.files import write_atomically

    options = ReadOptions(args.hand, tuple(args.mesh), args.mesh_scale, args.cell)
    content = score_files(args.files, args.protocol, options, seed=args.seed, workers=args.workers)
    if args.out is not None:
        write_atomically(args.out / "scores.json", (json.dumps(content, indent=1) + "\n").encode())
        note(f"results are in {args.out / 'scores.json'}")
    if args.json:
        print_json(content)
    else:
        print(render_scores(content))
    return 0 if any(cell["successes"] for cell in content["protocols"].values()) else 1


def render_scores(content: dict[str, Any]) -> str:
    """Return the scores as tables for a terminal."""
    from dexgrasp.runs.text import left_table, text_table

    names = list(content["protocols"])
    grasps = {row["grasp"]: row for row in content["rows"]}
    verdicts = {(row["grasp"], row["protocol"]): row for row in content["rows"]}
    labels = short_names(list(grasps))
    rows = [
        [labels[grasp], row["object"], *(_cell(verdicts[grasp, name]) for name in names)]
        for grasp, row in grasps.items()
    ]
    parts = [left_table(("grasp", "object", *names), rows)]
    summary = [
        [name, f"{cell['successes']}/{cell['trials']}", f"{cell['rate']:.1%}", _range(cell["ci95"]),
         _range(cell["ci95_objects"]), f"{cell['mean_score']:.2f}"]
        for name, cell in content["protocols"].items()
    ]  # fmt: skip
    parts.append(text_table(("protocol", "held", "rate", "95 %", "over objects", "mean score"), summary))
    parts.append(_metrics_line(content))
    failed = [
        [Path(r["grasp"]).name, r["protocol"], r["sentence"]] for r in content["rows"] if not r["success"]
    ]
    return "\n\n".join(
        parts + ([left_table(("grasp", "protocol", "why it failed"), failed)] if failed else [])
    )


def short_names(paths: Sequence[str]) -> dict[str, str]:
    """Return path -> its last parts, as many as it takes to tell all of them apart."""
    parts = {path: Path(path).parts for path in paths}
    deepest = max((len(own) for own in parts.values()), default=1)
    for count in range(1, deepest + 1):
        names = {path: "/".join(own[-count:]) for path, own in parts.items()}
        if len(set(names.values())) == len(names):
            return names
    return {path: path for path in paths}


def _cell(row: dict[str, Any]) -> str:
    return "held" if row["success"] else (f"{row['score']:.1f}" if row["score"] else "-")


def _range(ends: list[float]) -> str:
    return f"[{100 * ends[0]:.0f}, {100 * ends[1]:.0f}]"


def _metrics_line(content: dict[str, Any]) -> str:
    mean = content["metrics_mean"]
    text = (
        f"Mean of {content['grasps']} grasps: penetration {1000 * mean['penetration_m']:.1f} mm, self-penetration "
        f"{1000 * mean['self_penetration_m']:.1f} mm, contact distance {1000 * mean['contact_distance_m']:.1f} mm, "
        f"links within 2 mm {mean['contact_number']:.1f}, consistency {1000 * mean['contact_consistency_m']:.1f} mm."
    )
    if content["diversity"]:
        text += f" Variance in the first component: {content['diversity'][0]:.0%} (lower is more varied)."
    return text
