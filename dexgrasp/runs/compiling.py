"""The first use of compiled functions on a machine: shown, and by one process at a time."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numba
from numba.core import event
from numba.core.registry import cpu_target

from dexgrasp.runs.progress import Show, progress_bar
from dexgrasp_env import __version__
from dexgrasp_env.compiled import code_folder, uncollected
from dexgrasp_env.files import content_hash, lock


@contextmanager
def compiling(what: str) -> Iterator[None]:
    """Show how many functions a block compiles; other processes wait for it, and load what it has kept.

    Args:
        what: calls them; once it has ended on this machine, nobody waits for it again.
    """
    machine = cpu_target.target_context.codegen().magic_tuple()
    name = f"compiled-{content_hash(what, __version__, numba.__version__, machine)}"
    done = (code_folder() or Path("/dev/null")) / name
    with ExitStack() as stack:
        with suppress(OSError):  # nothing can be locked where nothing is kept
            if not done.exists():
                file = stack.enter_context(open(done.with_suffix(".lock"), "wb"))
                lock(file)
                if done.exists():
                    file.close()
        show = stack.enter_context(progress_bar("function", "compiling, once on this machine"))
        counter = _Counter(show)
        event.register("numba:compile", counter)
        stack.callback(event.unregister, "numba:compile", counter)
        stack.enter_context(uncollected())
        yield
        with suppress(OSError):
            done.touch()


class _Counter(event.Listener):
    """Shows each function that is compiled."""

    def __init__(self, show: Show) -> None:
        self._show, self._count = show, 0

    def on_start(self, event: event.Event) -> None:
        """Show what is compiled now."""
        self._show(self._count, None, now=event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: event.Event) -> None:
        """Count it."""
        self._count += 1
