"""What the code says of itself, in place of `{{ docstring module:Class }}`, `{{ module name }}`, `{{ commands }}`."""

import argparse
import importlib
import inspect
import re
from collections.abc import Iterator
from typing import Any

_DOCSTRING = re.compile(r"^\{\{ docstring ([\w.]+):(\w+) \}\}$", re.MULTILINE)
_MODULE = re.compile(r"^\{\{ module ([\w.]+) \}\}$", re.MULTILINE)
_SECTION = "## \\1\n\n```{eval-rst}\n.. automodule:: \\1\n```\n"
_CODE_OR_BAR = re.compile(r"(`+[^`]*`+)|\|")
_ARRAY = re.compile(r"[\w~.]*ndarray\[tuple\[[\w~.]*Any, \.\.\.\], [\w~.]*dtype\[[\w~.]*float64\]\]")


def setup(app: Any) -> dict[str, Any]:
    """Fill the pages in as they are read."""
    app.connect("source-read", _fill_in)
    app.connect("autodoc-process-docstring", _keep_norms)
    app.connect("autodoc-process-signature", _shorten)
    return {"parallel_read_safe": True}


def _fill_in(app: Any, name: str, source: list[str]) -> None:
    source[0] = _MODULE.sub(_SECTION, _DOCSTRING.sub(_docstring, source[0]))
    for mark, text in {"{{ commands }}": _commands, "{{ protocols }}": _protocols}.items():
        if mark in source[0]:
            source[0] = source[0].replace(mark, text())


def _keep_norms(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings write |x| for a norm, which reStructuredText takes for a substitution."""
    lines[:] = [_CODE_OR_BAR.sub(lambda found: found[1] or r"\|", line) for line in lines]


def _shorten(
    app: Any, what: str, name: str, obj: Any, options: Any, *signature: str | None
) -> tuple[str | None, ...]:
    """Arrays of floats bear the name that the sources give them."""
    return tuple(part and _ARRAY.sub("Array", part) for part in signature)


def _docstring(match: "re.Match[str]") -> str:
    return str(inspect.getdoc(getattr(importlib.import_module(match[1]), match[2])))


def _commands() -> str:
    """Every command's help as a section, those within others as well."""
    from dexgrasp.cli.commands import COMMANDS, make_parser

    return "\n\n".join(
        f"## {parser.prog}\n\n```text\n{parser.format_help()}```"
        for parser in _within(make_parser(*COMMANDS))
    )


def _within(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for own in action.choices.values():
                yield own
                yield from _within(own)


def _protocols() -> str:
    """What `dexgrasp list protocols` says, as a table."""
    from dexgrasp.cli.list import list_protocols

    rows = [f"| `{row['name']}` | {row['env']} | {row['description']} |" for row in list_protocols()]
    return "\n".join(["| name | of | what is special |", "| --- | --- | --- |", *rows])
