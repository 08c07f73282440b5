"""`dexgrasp report`: tables and plots from evaluations."""

import argparse
from pathlib import Path

from dexgrasp.cli.options import add_json

_EPILOG = """examples:
  dexgrasp report runs/tables                    markdown on stdout; report.html, report.md and plots in the folder
  dexgrasp report runs/a runs/b --out report     several evaluations in one report
The paper's Tables 1-3 stand beside ours, and 4-6 where the agents report certificates and times."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "report", help="tables and plots from evaluations, the paper's beside ours", epilog=_EPILOG,
        description="Write report.html (one page that needs no other file) and report.md from `dexgrasp evaluate`.",
    )  # fmt: skip
    parser.add_argument("folders", nargs="+", type=Path, metavar="DIR", help="the --out of an evaluation")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="where report.html, report.md and the plots go (default: the first DIR)",
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Write the report and print it."""
    from dexgrasp.cli.output import note, print_json
    from dexgrasp.evaluation.report.build import read_agents, write_report

    out = args.out or args.folders[0]
    text = write_report(args.folders, out)
    note(f"report and plots are in {out}")
    if args.json:
        print_json(
            {
                "schema": 1,
                "report": str(out / "report.md"),
                "html": str(out / "report.html"),
                "agents": read_agents(args.folders),
            }
        )
    else:
        print(text, end="")
    return 0
