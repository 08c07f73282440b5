"""Pages filled in from the code: `{{ docstring module:Class }}`, `{{ settings module:Class }}`, `{{ module name }}`."""

import argparse
import dataclasses
import importlib
import inspect
import re
from collections.abc import Iterator
from typing import Any

_DOCSTRING = re.compile(r"^\{\{ docstring ([\w.]+):(\w+) \}\}$", re.MULTILINE)
SETTINGS = re.compile(r"^\{\{ settings ([\w.]+):(\w+) \}\}$", re.MULTILINE)
_ATTRIBUTE = re.compile(r"^ {4}(\w+): (.*(?:\n {8,}.*)*)", re.MULTILINE)
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
    text = SETTINGS.sub(lambda found: settings_table(*found.groups()), source[0])
    source[0] = _MODULE.sub(_SECTION, _DOCSTRING.sub(_docstring, text))
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


def settings_of(module: str, name: str) -> dict[str, tuple[str, str]]:
    """Return default and meaning of each field of a settings class, inherited ones included."""
    kind = getattr(importlib.import_module(module), name)
    meanings: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        meanings |= {
            field: " ".join(text.split())
            for field, text in _ATTRIBUTE.findall(inspect.cleandoc(base.__doc__ or ""))
        }
    return {field.name: (_default(field), meanings.get(field.name, "")) for field in dataclasses.fields(kind)}


def settings_table(module: str, name: str) -> str:
    """Return a settings class as a table: setting, default, meaning with unit and source."""
    rows = [
        f"| `{field}` | {default} | {_in_cell(meaning)} |"
        for field, (default, meaning) in settings_of(module, name).items()
    ]
    return "\n".join(["| setting | default | meaning, unit, source |", "| --- | --- | --- |", *rows])


def _default(field: "dataclasses.Field[Any]") -> str:
    if field.default is dataclasses.MISSING:
        return (
            "" if field.default_factory is dataclasses.MISSING else _in_cell(f"`{field.default_factory()}`")
        )
    return _in_cell(f"`{field.default}`")


def _in_cell(text: str) -> str:
    return text.replace("|", "\\|")


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
