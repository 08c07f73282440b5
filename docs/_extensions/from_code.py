"""What pages show of the code: written into them between `<!-- from code: KIND NAME ... -->` and `<!-- /from code -->`.

`scripts/fill_pages.py` writes it, so that pages can be read where they lie. On the site, built from the same pages,
modules and commands are shown whole.
"""

import argparse
import dataclasses
import importlib
import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

BLOCK = re.compile(
    r"^<!-- from code: (?P<kind>\w+)(?P<names>[\s\w.:]*) -->\n(?P<text>.*?)^<!-- /from code -->$",
    re.MULTILINE | re.DOTALL,
)
_ATTRIBUTE = re.compile(r"^ {4}(\w+): (.*(?:\n {8,}.*)*)", re.MULTILINE)
_CODE_OR_BAR = re.compile(r"(`+[^`]*`+)|\|")
_ARRAY = re.compile(r"[\w~.]*ndarray\[tuple\[[\w~.]*Any, \.\.\.\], [\w~.]*dtype\[[\w~.]*float64\]\]")


def setup(app: Any) -> dict[str, Any]:
    """Fill the pages in as they are read."""
    app.connect("source-read", _fill_in)
    app.connect("autodoc-process-docstring", _keep_norms)
    app.connect("autodoc-process-signature", _shorten)
    return {"parallel_read_safe": True}


def filled(page: str, kinds: dict[str, Callable[..., str]] | None = None) -> str:
    """Return a page with what the code says now between its marks."""

    def written(found: "re.Match[str]") -> str:
        mark = found[0].partition("-->")[0] + "-->"
        text = (kinds or _KINDS)[found["kind"]](*found["names"].split())
        return f"{mark}\n\n{text.strip()}\n\n<!-- /from code -->"

    return BLOCK.sub(written, page)


def _fill_in(app: Any, name: str, source: list[str]) -> None:
    source[0] = filled(source[0], _KINDS | {"modules": _whole_modules, "commands": _whole_commands})


def _keep_norms(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings write |x| for a norm, which reStructuredText takes for a substitution."""
    lines[:] = [_CODE_OR_BAR.sub(lambda found: found[1] or r"\|", line) for line in lines]


def _shorten(
    app: Any, what: str, name: str, obj: Any, options: Any, *signature: str | None
) -> tuple[str | None, ...]:
    """Arrays of floats bear the name that the sources give them."""
    return tuple(part and _ARRAY.sub("Array", part) for part in signature)


def _docstring(name: str) -> str:
    return str(inspect.getdoc(_named(name)))


def _named(name: str) -> Any:
    module, _, kind = name.partition(":")
    return getattr(importlib.import_module(module), kind)


def settings_of(name: str) -> dict[str, tuple[str, str]]:
    """Return default and meaning of each field of a settings class, `module:Class`, inherited ones included."""
    kind = _named(name)
    meanings: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        meanings |= {
            field: " ".join(text.split())
            for field, text in _ATTRIBUTE.findall(inspect.cleandoc(base.__doc__ or ""))
        }
    return {field.name: (_default(field), meanings.get(field.name, "")) for field in dataclasses.fields(kind)}


def settings_table(name: str) -> str:
    """Return a settings class as a table: setting, default, meaning with unit and source."""
    rows = [
        f"| `{field}` | {default} | {_in_cell(meaning)} |"
        for field, (default, meaning) in settings_of(name).items()
    ]
    return "\n".join(["| setting | default | meaning, unit, source |", "| --- | --- | --- |", *rows])


def _default(field: "dataclasses.Field[Any]") -> str:
    if field.default is not dataclasses.MISSING:
        return _in_cell(f"`{_shown(field.default)}`")
    if field.default_factory is dataclasses.MISSING:
        return ""
    return _in_cell(f"`{_shown(field.default_factory())}`")


def _shown(value: Any) -> str:
    """Return a default as text: of settings that differ from their own defaults, the difference."""
    if not dataclasses.is_dataclass(value):
        return str(value)
    usual = {field.name: field.default for field in dataclasses.fields(value)}
    differing = [
        f"{name}={getattr(value, name)}" for name, own in usual.items() if getattr(value, name) != own
    ]
    return f"{type(value).__name__}({', '.join(differing)})" if differing else str(value)


def _in_cell(text: str) -> str:
    return text.replace("|", "\\|")


def _modules(*names: str) -> str:
    """Modules as links from a page of docs/api; the site shows them whole."""
    return "\n".join(f"- [`{_file(name)}`](../../{_file(name)})" for name in names)


def _file(name: str) -> str:
    return f"{name.replace('.', '/')}.py"


def _whole_modules(*names: str) -> str:
    """All that modules have for others, each as a section."""
    return "\n".join(f"## {name}\n\n```{{eval-rst}}\n.. automodule:: {name}\n```\n" for name in names)


def _commands() -> str:
    """What `dexgrasp --help` lists, as a table."""
    from dexgrasp.cli.commands import COMMANDS

    rows = [f"| `{name}` | {_in_cell(line)} |" for name, line in COMMANDS.items()]
    return "\n".join(["| `dexgrasp` ... | does |", "| --- | --- |", *rows])


def _whole_commands() -> str:
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

    of, rows = None, []
    for row in list_protocols():
        if row["env"] == "grasp files":
            break  # those of `score` have a page
        if row["env"] != of:
            of = row["env"]
            rows.append(f"| **{of or 'means'}** | |")
        rows.append(f"| `{row['name']}` | {row['description']} |")
    return "\n".join(["| name | what is special |", "| --- | --- |", *rows])


_KINDS: dict[str, Callable[..., str]] = {
    "docstring": _docstring,
    "settings": settings_table,
    "protocols": _protocols,
    "modules": _modules,
    "commands": _commands,
}
