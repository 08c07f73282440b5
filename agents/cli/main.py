"""The console script: signals are caught before anything heavy is imported."""

import gc
import sys

from agents import interrupt

OK, ANSWER_IS_NO, BAD_INPUT, INTERRUPTED, INTERNAL_ERROR = 0, 1, 2, interrupt.EXIT_CODE, 70


def main(argv: "list[str] | None" = None) -> int:
    """Run one command and return its exit code.

    Args:
        argv: the arguments; without them those of the process, whose signals are then this function's to catch.
    """
    if argv is not None:
        return _run(argv)
    try:
        try:
            interrupt.catch()
            code = _run(sys.argv[1:])
        finally:
            interrupt.stop()
            gc.freeze()  # the process ends: a last search for cycles would take a tenth of a short command
    except KeyboardInterrupt:  # raised in between
        code = INTERRUPTED
    return INTERRUPTED if interrupt.requested() else code


def _run(arguments: list[str]) -> int:
    from agents.cli.commands import run_command

    return run_command(arguments)


if __name__ == "__main__":
    sys.exit(main())
