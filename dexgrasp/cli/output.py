"""Output of commands: one JSON object on standard output, or tables for a terminal; all else on standard error."""

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any

from dexgrasp.runs.text import text_table
from dexgrasp_env.arrays import Fields

if TYPE_CHECKING:
    from dexgrasp.grasp.verify.check import Check


@contextmanager
def quiet(active: bool) -> Iterator[None]:
    """Redirect standard output to standard error while active, that of native libraries as well."""
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
    """Add to the message of an interruption what is kept, and that the same command resumes."""
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
    """Return the mark of a check that holds or fails."""
    return coloured("ok  ", "good") if good else coloured("FAIL", "bad")


def shown(value: Any) -> str:
    """Return a value as text; a float has four digits."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e5 else f"{value:.0f}"
    if isinstance(value, Mapping):
        return ", ".join(f"{key}={shown(part)}" for key, part in value.items()) or "-"
    if isinstance(value, list | tuple):
        return ", ".join(map(shown, value))
    return "-" if value is None else str(value)


def columns(figures: Fields) -> list[str]:
    """Return a line for each figure, the values aligned."""
    width = max(map(len, figures), default=0)
    return [f"{name:<{width}}  {shown(value)}" for name, value in figures.items()]


def record_table(rows: Sequence[Fields]) -> str:
    """Return records, which have the same keys, as a table."""
    return text_table(tuple(rows[0]), [list(map(shown, row.values())) for row in rows], words=True)


def tables(figures: Fields) -> str:
    """Return nested figures as text: each list of records as a table, then a line for each other figure."""
    records = {
        name: value
        for name, value in figures.items()
        if isinstance(value, list) and value and isinstance(value[0], Mapping)
    }
    others = _flat({name: value for name, value in figures.items() if name not in records})
    parts = [f"{name}:\n{record_table(rows)}" for name, rows in records.items()]
    return "\n\n".join([*parts, "\n".join(columns(others))])


def _flat(case: Mapping[str, Any], prefix: str = "") -> Fields:
    flat = Fields()
    for key, value in case.items():
        name = f"{prefix}{key.replace('_', ' ')}"
        flat |= _flat(value, f"{name} ") if isinstance(value, Mapping) else {name: value}
    return flat
