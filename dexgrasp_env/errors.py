"""Errors that are the user's to mend."""

import difflib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class InputError(ValueError):
    """Bad input: the message is one line that says what is wrong and what is valid.

    The command line prints it without a traceback and exits with 2.
    """


def unknown_name(kind: str, name: object, valid: object) -> InputError:
    """Return the error for a name that is not among the valid ones.

    Args:
        kind: what was named, e.g. `"control_mode"`.
        name: what was given.
        valid: an iterable of the valid names.
    """
    names = list(map(str, valid))  # type: ignore[call-overload]
    near = difflib.get_close_matches(str(name), names, n=1)
    hint = f" (the nearest is {near[0]!r})" if near else ""
    return InputError(f"unknown {kind} {shortened(repr(name), 200)}{hint}: valid are {', '.join(names)}")


def shortened(text: str, most: int) -> str:
    """Return a text as one line of at most so many characters."""
    line = " ".join(text.split())
    return line if len(line) <= most else line[: most - 3] + "..."


class UnknownArgumentError(InputError, TypeError):
    """An argument that nothing takes: also the TypeError that Python raises for one, which other libraries expect."""


def unknown_argument(name: str, valid: object) -> UnknownArgumentError:
    """Return the error for a keyword that is not among the valid ones, in Python's own words first.

    Args:
        name: what was given.
        valid: an iterable of the valid names.
    """
    words = ", ".join(map(str, valid))  # type: ignore[call-overload]
    return UnknownArgumentError(f"got an unexpected keyword argument {name!r}: valid are {words}")


def first_line(error: BaseException) -> str:
    """Return the first line of what an error says, its kind where it says nothing."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


@contextmanager
def understood(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a parser raises on a damaged file into one line.

    Raises:
        InputError: for any error within.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"{path} cannot be read as {kind} ({type(error).__name__}: {first_line(error)})"
        ) from None
