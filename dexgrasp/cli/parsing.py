"""Options of argparse from the dataclasses of `command`."""

import argparse
import inspect
import os
import re
from collections.abc import Callable, Collection
from dataclasses import MISSING, Field, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, cast, get_args, get_origin

from dexgrasp.cli.command import POSITIONAL, Command, Script
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import TEXT, Hint, Rule, hint_of, hints, read

C = TypeVar("C", bound=Script)


def texts(owner: Any) -> tuple[str, str, dict[str, str]]:
    """Split the docstring of a class or module: first paragraph, the rest, and the line of each attribute."""
    above, _, section = (inspect.getdoc(owner) or "").partition("\nAttributes:\n")
    description, _, below = above.partition("\n\n")
    attributes = re.findall(r"^    (\w+): (.*(?:\n     .*)*)", section, re.MULTILINE)
    return _line(description), below.strip(), {name: _line(text) for name, text in attributes}


def _line(text: str) -> str:
    return " ".join(text.split())


def build(kind: type[C], args: argparse.Namespace) -> C:
    """Return a command or script with its parsed options.

    Raises:
        InputError: for settings that are not valid, or an option that has no effect without another.
    """
    given = Fields()
    for path, value in vars(args).items():
        *within, name = path.split(".")
        place = given
        for part in within:
            place = place.setdefault(part, {})
        place[name] = tuple(value) if isinstance(value, list) else value
    made = read(kind, given, more=True)
    known = hints(cast(Any, kind))
    for name, hint in known.items():
        details = _details(hint)
        other, unasked = details.get("of"), os.environ.get(details.get("variable", ""))
        if name in given and other and not getattr(made, other) and given[name] != unasked:
            idle = given[name] if isinstance(given[name], dict) else [name]
            words = ", ".join(f"--{part}" for part in idle)
            needed = other.upper() if POSITIONAL in known[other].marks else f"--{other}"
            raise InputError(f"{words} would change nothing without {needed}".replace("_", "-"))
    return made


def _details(hint: Hint) -> Fields:
    """Return the mappings of a field's annotation, merged."""
    return {key: value for mark in hint.marks if isinstance(mark, dict) for key, value in mark.items()}


def add_options(
    parser: argparse.ArgumentParser, kind: Any, path: str = "", chosen: Collection[str] = frozenset()
) -> None:
    """Add an option for every field of a dataclass; base classes and nested dataclasses become groups of options.

    Args:
        parser: of the command.
        kind: the dataclass.
        path: names of the fields that lead to it, each followed by a dot.
        chosen: names of fields: those to add (tuple), or those to leave out (set).
    """
    listed = isinstance(chosen, tuple)
    seen = set() if listed else set(chosen)
    for owner in kind.__mro__:
        title, _, lines = texts(owner)
        apart = path or owner not in (kind, Command)
        place = parser.add_argument_group(title.rstrip(".")) if apart else parser
        for name in vars(owner).get("__annotations__", ()):
            if name in seen:
                continue
            seen.add(name)
            hint = hints(kind)[name]
            if is_dataclass(hint.kind):
                named = next((mark for mark in hint.marks if isinstance(mark, tuple | set)), chosen)
                add_options(parser, hint.kind, f"{path}{name}.", named)
            elif name in chosen or not listed:
                _add(place, path + name, kind.__dataclass_fields__[name], hint, lines.get(name, ""))


def _add(place: Any, path: str, field: "Field[Any]", hint: Hint, line: str) -> None:
    default = field.default if field.default_factory is MISSING else field.default_factory()
    settings = {"help": _help(line, default)} | _value(field.name, hint) | _details(hint)
    settings.pop("of", None)
    settings["default"] = os.environ.get(settings.pop("variable", ""), argparse.SUPPRESS)
    if POSITIONAL in hint.marks:
        if default is not MISSING:
            settings["nargs"] = "*" if "nargs" in settings else "?"
        place.add_argument(path, **settings)
    else:
        flags = [mark for mark in hint.marks if str(mark).startswith("--")]
        other = settings.pop("instead_of", None)
        place.add_argument(
            *flags or [f"--{field.name.replace('_', '-')}"],
            dest=path,
            required=default is MISSING,
            **settings,
        )
        if other:
            both = [action for action in place._actions if action.dest in (path, other)]
            place.add_mutually_exclusive_group()._group_actions += both


def _help(line: str, default: Any) -> str:
    text, values = line.rstrip("."), default if isinstance(default, tuple) else (default,)
    shown = (str, int, float, Path)
    said = values and all(isinstance(value, shown) and value is not False for value in values)
    if said and "default" not in text:
        text += f" (default {' '.join(f'{v:g}' if isinstance(v, float) else str(v) for v in values)})"
    return text.replace("%", "%%")


def _value(name: str, hint: Hint) -> Fields:
    """Return the keywords of `add_argument` for a value."""
    if hint.kind is bool:
        return {"action": "store_true"}
    found = Fields()
    words = [mark for mark in hint.marks if isinstance(mark, str) and not mark.startswith("--")]
    if get_origin(hint.kind) is tuple and (hint.rule is None or hint.rule.parse is str):
        first, *rest = get_args(hint.kind)
        hint = hint_of(first)
        found["nargs"] = "+" if rest[-1] is Ellipsis else 1 + len(rest)
        words = words or [mark for mark in hint.marks if isinstance(mark, str)]
    rule = hint.rule or TEXT
    if rule.choices:
        return found | {"choices": rule.choices}
    words = words or [{int: "N", float: "X"}.get(hint.kind, name.upper())]
    several = isinstance(found.get("nargs"), int) and len(words) > 1
    return found | {"metavar": tuple(words) if several else words[-1], "type": reader(rule)}


def reader(rule: Rule) -> Callable[[str], Any]:
    """Return the `type` of argparse for a rule: parses and validates a word of the command line."""

    def parse(text: str) -> Any:
        """Return the value of a word of the command line."""
        if text == argparse.SUPPRESS:  # argparse reads the default of a place that is left empty like a word
            return text
        try:
            return rule.validate(rule.parse(text))
        except (TypeError, ValueError, OverflowError) as error:
            words = error if isinstance(error, InputError) else f"{text!r} is not {rule.words}"
            raise argparse.ArgumentTypeError(str(words)) from None

    return parse
