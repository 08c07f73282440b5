"""`dexgrasp compare`: two agents of an evaluation, scene by scene."""

import argparse
from pathlib import Path

from dexgrasp.cli.options import add_json

_EPILOG = """examples:
  dexgrasp evaluate --agents bilevel hardcoded --objects all20 --trials 6 --out runs/tables
  dexgrasp compare runs/tables bilevel hardcoded
  dexgrasp compare runs/seed_0 runs/seed_1 bilevel hardcoded

Both have met the same scenes, so only those count that one alone solved: an exact McNemar test over them. Differences
are in points of a hundred, with Newcombe's interval for paired rates; what is said of new objects comes from drawing
objects anew."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "compare", help="two agents of an evaluation on the same scenes", epilog=_EPILOG,
        description="Compare two agents scene by scene: what one alone solves, an exact test, the difference.",
    )  # fmt: skip
    parser.add_argument("folders", type=Path, metavar="RUN", nargs="+", help="the --out of evaluations")
    parser.add_argument("a", metavar="A", help="an agent of these")
    parser.add_argument("b", metavar="B", help="another one")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Compare and print."""
    from dexgrasp.cli.output import print_json
    from dexgrasp.evaluation.comparison import compare_agents, render_comparison

    content = compare_agents(args.folders, args.a, args.b)
    if args.json:
        print_json(content)
    else:
        print(render_comparison(content))
    return 0
