"""`dexgrasp check`: an exported trajectory looked at before a robot moves."""

import argparse
from pathlib import Path

from dexgrasp.cli.options import add_cell, add_json, add_seed, natural_int

_EPILOG = """examples:
  dexgrasp check robot/pear                           limits, timing, collisions
  dexgrasp check robot/pear --replay 20               and 20 open-loop replays in MuJoCo, the object 3 mm and 1 deg off

TRAJECTORY is a folder with arm.csv and hand.csv, or a trajectory.json. What reads it shares no code with what wrote it.
--replay needs scene.xml, from `dexgrasp export --format mjcf`, beside the trajectory. Exit code 0 only if all holds."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "check", help="limits, timing and collisions of an exported trajectory", epilog=_EPILOG,
        description="Check a trajectory by an independent reader.",
    )  # fmt: skip
    parser.add_argument("trajectory", type=Path, metavar="TRAJECTORY", help="a folder or a trajectory.json")
    parser.add_argument(
        "--replay", type=natural_int, default=0, metavar="N", help="replay it N times in simulation"
    )
    add_seed(parser, "of the object's errors")
    add_cell(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Check, replay if asked for, print."""
    from dataclasses import asdict

    from dexgrasp.cli.output import coloured, mark, print_json
    from dexgrasp.export.check import check_trajectory
    from dexgrasp.export.read import read_trajectory

    recording = read_trajectory(args.trajectory)
    findings = check_trajectory(recording)
    good = all(finding.holds for finding in findings)
    held = _replays(args, recording) if args.replay else []
    if args.json:
        content = {"schema": 1, "holds": good, "checks": [asdict(finding) for finding in findings]}
        print_json(content | {"replays": len(held), "held": sum(held)})
    else:
        width = max(len(finding.name) for finding in findings)
        for f in findings:
            print(f"{mark(f.holds)}  {f.name:<{width}}  {f.value:12.3e}   {f.bound}")
        print(coloured("every check holds", "good") if good else coloured("NOT fit to run", "bad"))
        if held:
            print(f"held in {sum(held)} of {len(held)} open-loop replays, the object 3 mm and 1 deg off")
    return 0 if good else 1


def _replays(args: argparse.Namespace, recording: "object") -> list[bool]:
    """Whether the object was held, for each replay."""
    import numpy as np
    from tqdm import tqdm

    from dexgrasp.export.replay import replay

    folder = args.trajectory if args.trajectory.is_dir() else args.trajectory.parent
    return [
        replay(recording, folder / "scene.xml", np.random.default_rng([args.seed, k])).success  # type: ignore[arg-type]
        for k in tqdm(range(args.replay), unit="replay", leave=False, delay=0.5)
    ]
