"""The console script: signals are caught before anything heavy is imported."""

import gc
import os
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
            _keep_blas_to_one_thread()
            code = _run(sys.argv[1:])
        finally:
            interrupt.stop()
            gc.freeze()  # the process ends: a last search for cycles would take a tenth of a short command
    except KeyboardInterrupt:  # raised in between
        code = INTERRUPTED
    return INTERRUPTED if interrupt.requested() else code


def _keep_blas_to_one_thread() -> None:
    """Have numpy and scipy multiply in the calling thread, unless the user has set how many there are to be.

    Matrices here are small: further threads would wait busily, which costs `plan` 40 % more of CPU time on two cores.
    """
    if "OMP_NUM_THREADS" not in os.environ:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def _run(arguments: list[str]) -> int:
    from agents.cli.commands import run_command

    return run_command(arguments)


if __name__ == "__main__":
    sys.exit(main())
