"""The command line: finds the command, runs it, and turns what went wrong into an exit code."""

import argparse
import errno
import importlib
import io
import os
import sys
import traceback
from collections.abc import Sequence
from typing import Any, NoReturn

from dexgrasp.cli.main import BAD_INPUT, INTERNAL_ERROR, INTERRUPTED, OK
from dexgrasp.cli.output import json_output
from dexgrasp.runs import interrupt
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import missing_extra

COMMANDS = {
    name: f"dexgrasp.cli.{name}"
    for name in (
        "demo", "list", "plan", "verify", "evaluate", "compare", "score", "replay", "report", "dataset", "demos",
        "train", "benchmark", "doctor", "export", "check", "view", "completion",
    )
}  # fmt: skip
"""Command -> module with `add_parser(subparsers)` and `run(args) -> int`."""

_SURROUNDINGS = (
    errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENAMETOOLONG, errno.EFBIG, errno.EMFILE,
    errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ELOOP,
)  # fmt: skip
"""What the file system may say no with: the user's to mend."""

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


def run_command(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    _put_gl_aside()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # names of files need not be text
            stream.reconfigure(errors="backslashreplace")
    try:
        args = _parsed(arguments)
    except SystemExit as end:  # argparse: --help is 0, a mistake is 2
        return int(end.code or 0)
    except InputError as error:
        return _refused(_named_command(arguments) or "", error)
    except KeyboardInterrupt:
        return _interrupted("")
    with json_output(getattr(args, "json", False)):
        return _guarded(args)


def _put_gl_aside() -> None:
    """Keep MUJOCO_GL from `import mujoco`, which raises where its value is bad; `rendering` knows the wish.

    A command that draws nothing does its work whatever the variable says.
    """
    if "MUJOCO_GL" in os.environ and "mujoco" not in sys.modules:
        os.environ["DEXGRASP_GL"] = os.environ.pop("MUJOCO_GL")


def make_parser(only: str | None = None) -> Parser:
    """Return the parser with every command, or with one of them (which is faster)."""
    parser = Parser(
        prog="dexgrasp", epilog=_EPILOG,
        description="Dexterous grasping on a table: plan, execute, evaluate, learn.",
    )  # fmt: skip
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", dest="command", parser_class=Parser)
    for name in [only] if only else COMMANDS:
        importlib.import_module(COMMANDS[name]).add_parser(commands)
    parser.set_defaults(parser=parser)
    return parser


def _parsed(arguments: Sequence[str]) -> argparse.Namespace:
    """As argparse does it, but what is unknown is said of the command, whose help has what is known."""
    named = _named_command(arguments)
    args, unknown = make_parser(named).parse_known_args(arguments)
    if unknown:
        prog = f"dexgrasp {named}" if named else "dexgrasp"
        Parser(prog=prog).error(f"unrecognized arguments: {' '.join(unknown)}")
    return args


def _named_command(arguments: Sequence[str]) -> str | None:
    return arguments[0] if arguments and arguments[0] in COMMANDS else None


def _guarded(args: argparse.Namespace) -> int:
    try:
        if args.command is None:
            return _no_command(args)
        return int(importlib.import_module(COMMANDS[args.command]).run(args))
    except InputError as error:
        if interrupt.requested():
            return _interrupted(f" {args.command}")
        return _refused(args.command, error)
    except ModuleNotFoundError as error:
        return _without(args.command, error)
    except KeyboardInterrupt as request:
        return _interrupted(f" {args.command}", str(request))
    except BrokenPipeError:  # the reader, such as `head`, has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except Exception as error:
        return _unexpected(args.command, error)


def _refused(command: str, error: InputError) -> int:
    print(f"dexgrasp {command}: {' '.join(str(error).split())}", file=sys.stderr)
    return BAD_INPUT


def _without(command: str, error: ModuleNotFoundError) -> int:
    """Say which extra brings a module that is not installed."""
    missing = missing_extra(error)
    if missing is None:
        return _unexpected(command, error)
    print(f"dexgrasp {command}: {missing}", file=sys.stderr)
    return BAD_INPUT


def _unexpected(command: str, error: Exception) -> int:
    if interrupt.requested():  # libraries make other exceptions of it
        return _interrupted(f" {command}")
    if isinstance(error, OSError) and error.errno in _SURROUNDINGS:
        where = f"{error.filename}: " if error.filename else ""
        print(f"dexgrasp {command}: {where}{error.strerror}", file=sys.stderr)
        return BAD_INPUT
    traceback.print_exc()
    print(f"dexgrasp {command}: this is a fault of dexgrasp's, please report it", file=sys.stderr)
    return INTERNAL_ERROR


def _no_command(args: argparse.Namespace) -> int:
    if args.version:
        from dexgrasp_env import __version__

        print(f"dexgrasp {__version__}")
        return OK
    args.parser.print_help(sys.stderr)
    return BAD_INPUT


def _interrupted(command: str, kept: str = "") -> int:
    interrupt.acknowledge()
    print(f"dexgrasp{command}: interrupted" + (f"; {kept}" if kept else ""), file=sys.stderr)
    return INTERRUPTED
