"""SIGINT and SIGTERM as one request to stop: raised where it is safe, asked for again where it was swallowed.

Libraries swallow exceptions while they are imported (trimesh wraps its imports in `except BaseException`) or crash, and
destructors and callbacks of native code swallow them too. A request that comes during an import is therefore raised
after it; one that was raised is raised again until somebody says `acknowledge`. This module imports nothing heavy: it
comes before everything else.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

EXIT_CODE = 3
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_RETRY = 0.05  # s until it is tried again while it may not be raised

_active = False  # whether requests may be raised
_requested = False
_held = 0  # depth of `held`


def catch() -> None:
    """Raise KeyboardInterrupt in the main thread at either signal from now on; at the second one end the process."""
    global _active
    _active = True
    signal.signal(signal.SIGALRM, _on_signal)
    sys.unraisablehook = _unraisable
    _watch_for_the_second()
    for number in _SIGNALS:
        signal.signal(number, _on_signal)
    # `python -m dexgrasp_env` blocks them while the package is imported.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)


def stop() -> None:
    """End the catching: the exit code is decided, and what comes now is too late to change it."""
    global _active
    _active = False
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    acknowledge()


def acknowledge() -> None:
    """Stop raising the request again: it has been understood."""
    signal.setitimer(signal.ITIMER_REAL, 0.0)


def requested() -> bool:
    """Return True when this process was asked to stop."""
    return _requested


@contextmanager
def held() -> Iterator[None]:
    """Finish what saves results; a request that comes meanwhile is raised afterwards."""
    global _held
    _held += 1
    try:
        yield
    finally:
        _held -= 1


@contextmanager
def not_inherited() -> Iterator[None]:
    """Start processes that Ctrl-C leaves alone: it is their parent's to tell them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _on_signal(number: int, frame: FrameType | None) -> None:
    global _requested
    if not _active or (number == signal.SIGALRM and not _requested):
        return
    _requested = True
    if _held or _importing(frame):
        signal.setitimer(signal.ITIMER_REAL, _RETRY)
        return
    signal.setitimer(signal.ITIMER_REAL, 3.0)  # s until it is raised again, unless acknowledged
    raise KeyboardInterrupt


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _unraisable(args: "sys.UnraisableHookArgs") -> None:
    """Ask for an interrupt again that a destructor or a callback dropped; drop what follows from it."""
    if args.exc_type is KeyboardInterrupt:
        signal.setitimer(signal.ITIMER_REAL, _RETRY)
    elif not _requested:  # an object that was closed half
        sys.__unraisablehook__(args)


def _watch_for_the_second() -> None:
    """Start a thread that sees the second signal at once: handlers wait for native code to return."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader,), daemon=True).start()


def _watch(reader: int) -> None:
    first: float | None = None
    while _active:
        for number in os.read(reader, 64):
            now = time.monotonic()
            if number not in _SIGNALS or not _active:
                continue
            if first is None:
                first = now
            elif now - first > 1.0:  # s: `timeout` and terminals send one wish to stop twice
                os.write(2, b"dexgrasp: stopped at once\n")
                os._exit(EXIT_CODE)
