"""Output of commands: one JSON object on standard output, everything else on standard error."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dexgrasp.grasp.verify.check import Check


@contextmanager
def quiet(active: bool) -> Iterator[None]:
    """While active, let standard error have what is printed, by native libraries as well."""
    if not active:
        yield
        return
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def note(message: str) -> None:
    """Print a line for people on standard error."""
    print(message, file=sys.stderr, flush=True)


@contextmanager
def resumable(kept: str) -> Iterator[None]:
    """Add to an interruption's message that `kept` is there, and that the same command goes on."""
    from dexgrasp.runs.pool import WorkerDiedError

    try:
        yield
    except (KeyboardInterrupt, WorkerDiedError) as stop:
        said = f"{stop}; {kept}" if str(stop) else kept
        raise KeyboardInterrupt(f"{said}: the same command goes on from there") from None


_COLOURS = {"good": 32, "look": 33, "bad": 31}  # green, yellow, red of the terminal's own palette


def coloured(text: str, kind: str) -> str:
    """Colour text that is printed on standard output where that is a terminal (and NO_COLOR is not set).

    Args:
        text: what is printed.
        kind: `good`, `look` or `bad`.
    """
    if not sys.stdout.isatty() or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return text
    return f"\x1b[{_COLOURS[kind]}m{text}\x1b[0m"


def check_lines(checks: "Sequence[Check]") -> list[str]:
    """Return a line for each check: whether it holds, its name, value and bound."""
    width = max(len(check.name) for check in checks)
    return [
        f"{mark(check.holds)}  {check.name:<{width}}  {check.value:12.3e}   {check.bound}" for check in checks
    ]


def mark(good: bool) -> str:
    """Return how a line of a list of checks begins."""
    return coloured("ok  ", "good") if good else coloured("FAIL", "bad")
