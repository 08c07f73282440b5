"""Progress of long work on standard error: a bar on a terminal, lines elsewhere."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Show = Callable[..., None]
"""Called with how many are done, of how many, and figures to show beside them."""
_EVERY = 10.0  # s between two lines


@contextmanager
def progress_bar(unit: str, of: str, *, shown: bool = True, **options: Any) -> Iterator[Show]:
    """Show how far work is.

    Args:
        unit: what is counted.
        of: what the work is.
        shown: whether anything is written.
        **options: of tqdm's bar.
    """
    if not shown:
        yield silent
    elif not sys.stderr.isatty():
        yield _lines(unit, of)
    else:
        from tqdm import tqdm

        # Work that is refused at once needs no bar.
        with tqdm(unit=unit, desc=of, **({"delay": 0.5} | options)) as bar:

            def show(done: int, total: int | None, **figures: str) -> None:
                """Move the bar."""
                if bar.total is None:  # what was there before says nothing of the speed
                    bar.n = bar.initial = done
                bar.total = total
                bar.set_postfix(figures, refresh=False)
                bar.update(done - bar.n)

            yield show


def silent(done: int, total: int | None, **figures: str) -> None:
    """Show nothing."""


def _lines(unit: str, of: str) -> Show:
    began = last = time.monotonic()

    def show(done: int, total: int | None, **figures: str) -> None:
        """Print a line, if the last is old enough or this ends the work."""
        nonlocal last
        now = time.monotonic()
        if now - last >= _EVERY or (done == total and last > began):
            last = now
            number = f"{done} of {total}" if total is not None else done
            more = "".join(f", {name} {value}" for name, value in figures.items())
            print(f"{of}: {unit} {number}, {now - began:.0f} s{more}", file=sys.stderr, flush=True)

    return show


def warn(text: str) -> None:
    """Print on standard error without spoiling a bar."""
    from tqdm import tqdm

    tqdm.write(text, file=sys.stderr)
