"""The command line: finds a command, runs it, and turns exceptions into one line and an exit code."""

import argparse
import errno
import importlib
import io
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

from dexgrasp.cli.codes import BAD_INPUT, INTERNAL_ERROR, INTERRUPTED, OK
from dexgrasp.cli.command import Script
from dexgrasp.cli.output import note, quiet
from dexgrasp.cli.parsing import add_options, build, texts
from dexgrasp.runs import interrupt
from dexgrasp_env import __version__
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import missing_extra

COMMANDS = {
    "demo": "plan a grasp, execute it, show and save the outcome",
    "list": "what objects, environments, agents and protocols there are",
    "plan": "one grasp with its certificate, or the reason why there is none",
    "verify": "check every constraint of a grasp again, independently",
    "evaluate": "rollouts of agents under the same protocols; resumable",
    "compare": "two agents of an evaluation on the same scenes",
    "score": "grasp files, ours or others', under published protocols",
    "replay": "one trial of an evaluation again, exactly",
    "report": "tables and plots from evaluations, the paper's beside ours",
    "dataset": "make and look at the grasp dataset",
    "demos": "demonstrations of any agent as Minari and LeRobot data sets",
    "train": "train networks; resumable",
    "benchmark": "speed as ratios measured side by side",
    "doctor": "what works on this machine, and whether a mesh is fit to use",
    "export": "a grasp as a trajectory for a robot, or its scene as MJCF",
    "check": "limits, timing and collisions of an exported trajectory",
    "robot": "robot files: what there is, one made of MJCF, one tested",
    "view": "a grasp in the browser, from approach to hold",
    "serve": "planner and agents over WebSocket, warm, for other programs",
    "warmup": "compile what plans and environments need, once",
}
"""Command -> what it does; the module of its name has a `Command` of that name, or several in `COMMANDS`."""

_SURROUNDINGS = (
    errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENAMETOOLONG, errno.EFBIG, errno.EMFILE,
    errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ELOOP,
)  # fmt: skip
"""Errors of the file system that are the user's to mend."""

_EPILOG = """examples:
  dexgrasp demo                                       plan a grasp of a box, execute it, save a video
  dexgrasp list objects                               what can be grasped
  dexgrasp plan mustard_bottle --json                 one grasp with its certificate
  dexgrasp evaluate --agents random hardcoded --objects seen --trials 3 --seed 0
  dexgrasp doctor my_mesh.stl                         is everything here, and is this mesh fit to use?

exit codes: 0 done; 1 done, but the answer is no; 2 bad input; 3 interrupted, with what was finished kept
`dexgrasp COMMAND --help` explains a command."""


class Parser(argparse.ArgumentParser):
    """Argument parser whose errors are one line."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)

    def error(self, message: str) -> NoReturn:
        """Print one line and exit with 2."""
        self.exit(BAD_INPUT, f"{self.prog}: {' '.join(message.split())} (see {self.prog} --help)\n")


def run_command(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    named = arguments[0] if arguments and arguments[0] in COMMANDS else ""
    return _run(f"dexgrasp {named}".strip(), partial(_parsed, named, arguments))


def run_script(
    command: "type[Script] | dict[str, type[Script]]", arguments: Sequence[str] | None = None
) -> int:
    """Run a script the way commands are run and return its exit code.

    Args:
        command: class of the script, or of each of its subcommands by name; the help is the docstring of its module.
        arguments: of the command line; None for those of the process.
    """
    kinds = list(command.values()) if isinstance(command, dict) else [command]
    module = sys.modules[kinds[0].__module__]
    parser = Parser(prog=Path(str(module.__file__)).name, description=module.__doc__)
    _add_options(parser, command)
    return _run(parser.prog, partial(parser.parse_args, arguments))


def _run(name: str, parse: Callable[[], argparse.Namespace]) -> int:
    if "MUJOCO_GL" in os.environ and "mujoco" not in sys.modules:
        # `import mujoco` raises where its value is bad; a command that draws nothing does its work whatever it says.
        os.environ["DEXGRASP_GL"] = os.environ.pop("MUJOCO_GL")  # `rendering` knows the wish
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # names of files need not be text
            stream.reconfigure(errors="backslashreplace")
    try:
        args = parse()
        as_json = getattr(args, "json", False)
        with quiet(as_json):
            answer = build(args.kind, args).run()
        return answer if isinstance(answer, int) else answer.show(as_json)
    except SystemExit as end:  # argparse: --help is 0, a mistake is 2
        return int(end.code or 0)
    except BrokenPipeError:  # the reader, such as `head`, has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except (Exception, KeyboardInterrupt) as error:
        return _stopped(name, error)


def make_parser(*named: str) -> Parser:
    """Return the parser, with the options of the named commands only: others are not imported."""
    parser = Parser(
        prog="dexgrasp", epilog=_EPILOG,
        description="Dexterous grasping on a table: plan, execute, evaluate, learn.",
    )  # fmt: skip
    parser.add_argument(
        "--version", action="version", version=f"dexgrasp {__version__}", help="print the version and exit"
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", dest="command", parser_class=Parser)
    for name, line in COMMANDS.items():
        if name in named:
            module = importlib.import_module(f"dexgrasp.cli.{name}")
            command = vars(module).get("COMMANDS") or vars(module)[name.capitalize()]
            _add_command(commands, name, line, command, module)
        else:
            commands.add_parser(name, help=line)
    return parser


def _add_command(place: Any, name: str, line: str, command: Any, module: Any = None) -> None:
    """Add a command, or a group of subcommands that the docstring of the module describes."""
    description, below, _ = texts(module if isinstance(command, dict) else command)
    _add_options(place.add_parser(name, help=line, description=description, epilog=below), command)


def _add_options(parser: Parser, command: Any) -> None:
    """Add the options of a command, or its subcommands."""
    if isinstance(command, dict):
        within = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
        for own, kind in command.items():
            _add_command(within, own, texts(kind)[0], kind)
    else:
        add_options(parser, command)
        parser.set_defaults(kind=command)


def _parsed(named: str, arguments: Sequence[str]) -> argparse.Namespace:
    """Parse arguments; an unknown one is reported with the name of its command, whose help lists the known ones."""
    parser = make_parser(named)
    args, unknown = parser.parse_known_args(arguments)
    if args.command is None:
        parser.print_help(sys.stderr)
        parser.exit(BAD_INPUT)
    if unknown:
        hint = ": the file of a cell is given by --robot" if "--cell" in unknown else ""
        Parser(prog=f"dexgrasp {named}").error(f"unrecognized arguments: {' '.join(unknown)}{hint}")
    return args


def _stopped(name: str, error: BaseException) -> int:
    """Print a user's mistake in one line, any other error with its traceback; return the exit code."""
    code = BAD_INPUT
    said: object = None
    if interrupt.requested() or isinstance(error, KeyboardInterrupt):  # libraries make other exceptions of it
        interrupt.acknowledge()
        code, said = INTERRUPTED, "interrupted"
        if isinstance(error, KeyboardInterrupt) and str(error):  # what is kept
            said = f"interrupted; {error}"
    elif isinstance(error, InputError):
        said = error
    elif isinstance(error, ModuleNotFoundError):
        said = missing_extra(error)
    elif isinstance(error, OSError) and error.errno in _SURROUNDINGS:
        said = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    elif isinstance(error, FileNotFoundError) and not error.filename:
        said = "the current folder is gone: change to another"
    if said is None:
        traceback.print_exception(error)
        code, said = INTERNAL_ERROR, "this is a fault of dexgrasp's, please report it"
    with suppress(OSError):  # of a full disk, say
        note(f"{name}: {' '.join(str(said).split())}")
    return code
