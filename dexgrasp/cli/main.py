"""The console script: signals are caught before anything heavy is imported."""

import gc
import os
import sys

from dexgrasp.cli.codes import INTERRUPTED
from dexgrasp.runs import interrupt


def main(argv: "list[str] | None" = None) -> int:
    """Run one command and return its exit code.

    Args:
        argv: the arguments; without them those of the process, whose signals are then this function's to catch.
    """
    if argv is not None:
        return _run(argv)
    try:
        try:
            _open_closed_streams()
            interrupt.catch()
            _keep_blas_to_one_thread()
            code = _run(sys.argv[1:])
        finally:
            interrupt.stop()
            _leave_cycles()
    except KeyboardInterrupt:  # raised in between
        code = INTERRUPTED
    return INTERRUPTED if interrupt.requested() else code


def _open_closed_streams() -> None:
    """Open closed standard streams on the null device: a file would take their number and get what is printed."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        setattr(sys, ("stdin", "stdout", "stderr")[number], os.fdopen(number, "w" if number else "r"))
    os.close(number)


def _keep_blas_to_one_thread() -> None:
    """Limit numpy and scipy to the calling thread, unless the user has set their threads.

    Matrices here are small: further threads would wait busily, which costs `plan` 40 % more of CPU time on two cores.
    """
    if "OMP_NUM_THREADS" not in os.environ:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def _leave_cycles() -> None:
    """Skip the last garbage collection, which would take a tenth of the time of a short command.

    Not where bindings made with nanobind are loaded: these print pages about objects that are left at exit.
    """
    if not any(name in sys.modules for name in ("ompl", "manifold3d", "ruckig", "fast_simplification")):
        gc.freeze()


def _run(arguments: list[str]) -> int:
    from dexgrasp.cli.commands import run_command

    return run_command(arguments)


if __name__ == "__main__":
    sys.exit(main())
