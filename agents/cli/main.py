"""The command line: finds the command, runs it, and turns what went wrong into an exit code."""

import argparse
import importlib
import importlib.util
import os
import signal
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType, ModuleType
from typing import Any, NoReturn

from agents.cli.output import json_output
from dexgrasp_env.errors import InputError

OK, ANSWER_IS_NO, BAD_INPUT, INTERRUPTED, INTERNAL_ERROR = 0, 1, 2, 3, 70

COMMANDS = {
    name: f"agents.cli.{name}"
    for name in (
        "demo", "list", "plan", "verify", "evaluate", "compare", "report", "dataset", "train", "benchmark", "view",
        "doctor",
    )
}  # fmt: skip
"""Command -> module with `add_parser(subparsers)` and `run(args) -> int`; a module that is not there is left out."""

_EPILOG = """examples:
  dexgrasp demo                                       plan a grasp of a box, execute it, save a video
  dexgrasp list objects                               what can be grasped
  dexgrasp plan mustard_bottle --json                 one grasp with its certificate
  dexgrasp evaluate --agents random hardcoded --objects seen --trials 3 --seed 0
  dexgrasp doctor my_mesh.stl                         is everything here, and is this mesh fit to use?

exit codes: 0 done; 1 done, but the answer is no; 2 bad input; 3 interrupted, with what was finished kept
`dexgrasp COMMAND --help` explains a command."""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def __init__(self, **kwargs: Any) -> None:
        settings: dict[str, Any] = {
            "formatter_class": argparse.RawDescriptionHelpFormatter,
            "allow_abbrev": False,
        }
        super().__init__(**(settings | kwargs))

    def error(self, message: str) -> NoReturn:
        """Print one line and exit with 2."""
        self.exit(BAD_INPUT, f"{self.prog}: {' '.join(message.split())} (see {self.prog} --help)\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; `argv` defaults to the process's arguments."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        args = make_parser(_named_command(arguments)).parse_args(arguments)
    except SystemExit as stop:  # argparse: --help is 0, a mistake is 2
        return int(stop.code or 0)
    with _sigterm_as_interrupt(), json_output(getattr(args, "json", False)):
        return _guarded(args)


def make_parser(only: str | None = None) -> Parser:
    """Return the parser with every command, or with one of them (which is faster)."""
    parser = Parser(
        prog="dexgrasp", epilog=_EPILOG,
        description="Dexterous grasping on a table: plan, execute, evaluate, learn.",
    )  # fmt: skip
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", dest="command", parser_class=Parser)
    for name in [only] if only else COMMANDS:
        module = _find(name)
        if module is not None:
            module.add_parser(commands)
    parser.set_defaults(parser=parser)
    return parser


def _find(name: str) -> ModuleType | None:
    module = COMMANDS[name]
    return importlib.import_module(module) if importlib.util.find_spec(module) else None


def _named_command(arguments: Sequence[str]) -> str | None:
    first = arguments[0] if arguments else ""
    return first if first in COMMANDS and importlib.util.find_spec(COMMANDS[first]) else None


def _guarded(args: argparse.Namespace) -> int:
    try:
        if args.command is None:
            return _no_command(args)
        return int(importlib.import_module(COMMANDS[args.command]).run(args))
    except InputError as error:
        print(f"dexgrasp {args.command}: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print(f"dexgrasp {args.command}: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader, such as `head`, has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except Exception:
        traceback.print_exc()
        print(f"dexgrasp {args.command}: this is a fault of dexgrasp's, please report it", file=sys.stderr)
        return INTERNAL_ERROR


def _no_command(args: argparse.Namespace) -> int:
    if args.version:
        from dexgrasp_env import __version__

        print(f"dexgrasp {__version__}")
        return OK
    args.parser.print_help(sys.stderr)
    return BAD_INPUT


@contextmanager
def _sigterm_as_interrupt() -> Iterator[None]:
    """Let a polite kill end like Ctrl-C, so that what was finished is kept."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # not the main thread: signals are somebody else's
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


if __name__ == "__main__":
    sys.exit(main())
