"""Rules of settings: stated once, at the field of a dataclass, and applied wherever a value enters.

    size: Annotated[float, number(ge=0, le=10)] = 1.0

`read` makes such a dataclass from a mapping of somebody else's; the command line makes options of the same fields.
"""

import inspect
import math
import numbers
import os
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache, reduce, wraps
from operator import or_
from pathlib import Path
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from dexgrasp_env.errors import InputError, shortened, unknown_name

Settings = TypeVar("Settings")
Called = TypeVar("Called", bound=Callable[..., Any])


class Rule(NamedTuple):
    """Rule for a value, and the words that state it.

    Attributes:
        words: what is valid, for messages.
        validate: returns a valid value as it is kept; raises ValueError, TypeError or AttributeError for another, or
            InputError to say more.
        parse: makes of a word of the command line what `validate` is asked of.
        choices: the valid values, where they are few.
    """

    words: str
    validate: Callable[[Any], Any]
    parse: Callable[[str], Any] = str
    choices: tuple[str, ...] = ()


def number(
    *, gt: float = -math.inf, ge: float = -math.inf, lt: float = math.inf, le: float = math.inf, whole: bool = False
) -> Rule:  # fmt: skip
    """Return the rule of finite numbers within bounds: above `gt`, from `ge` on, below `lt`, up to `le`."""
    kind, plain = (numbers.Integral, int) if whole else (numbers.Real, float)
    signs = {">": gt, ">=": ge, "<": lt, "<=": le}
    bounds = [f"{sign} {bound:g}" for sign, bound in signs.items() if math.isfinite(bound)]

    def validate(value: Any) -> float:
        """Return the number."""
        known = isinstance(value, kind) and not isinstance(value, bool) and math.isfinite(value)
        return plain(value) if known and gt < value < lt and ge <= value <= le else _refuse()

    noun = "a whole number" if whole else "a finite number"
    return Rule(f"{noun} {' and '.join(bounds)}".strip(), validate, plain)


def one_of(names: Iterable[str]) -> Rule:
    """Return the rule of a few names."""
    known = tuple(names)
    return Rule(
        ", ".join(known), lambda value: value if isinstance(value, str) and value in known else _refuse(), str, known
    )  # fmt: skip


def pair(each: Rule) -> Rule:
    """Return the rule of a range: two numbers that a rule admits, the first not above the second."""

    def validate(value: Any) -> tuple[float, float]:
        """Return the range."""
        low, high = map(each.validate, value)
        return (low, high) if low <= high else _refuse()

    return Rule(f"a pair low <= high, each {each.words}", validate)


def several(each: Rule, count: int | None = None, most: float = math.inf) -> Rule:
    """Return the rule of lists of what a rule admits, `count` long or up to `most`; kept as tuples."""

    def validate(value: Any) -> tuple[Any, ...]:
        """Return the values."""
        known = isinstance(value, list | tuple) and count in (None, len(value)) and len(value) <= most
        return tuple(map(each.validate, value)) if known else _refuse()

    size = f"{most} at most" if math.isfinite(most) else count or "any length"
    return Rule(f"a list of {size}, each {each.words}", validate)


def list_of(kind: type[Any], least: int = 0, most: int = 100, *, more: bool = False) -> Rule:
    """Return the rule of lists of a dataclass, each as `read` makes it; kept as tuples."""
    name = kind.__name__.lower()

    def validate(value: Any) -> tuple[Any, ...]:
        """Return what is made of each."""
        known = isinstance(value, list | tuple) and least <= len(value) <= most
        return (
            tuple(read(kind, one, f"{name} {k}", more=more) for k, one in enumerate(value))
            if known
            else _refuse()
        )

    return Rule(f"a list of {least} to {most}", validate)


def _distinct(value: Any) -> tuple[str, ...]:
    names = several(WORD).validate(value)
    return names if 0 < len(names) == len(set(names)) else _refuse()


def instance(kind: type, words: str) -> Rule:
    """Return the rule of the instances of a type."""
    return Rule(words, lambda value: value if isinstance(value, kind) else _refuse())


def _of_class(kind: Any) -> Rule | None:
    known = inspect.isclass(kind) and kind is not Any
    return instance(kind, f"{kind.__name__} of {kind.__module__}") if known else None


def _refuse() -> Any:
    raise ValueError


WORD = Rule(
    "a word", lambda value: value if isinstance(value, str) and value.isprintable() and value else _refuse()
)
Word = Annotated[str, WORD]
NAMES = Rule("a list of names, each once", _distinct)
Names = Annotated[tuple[str, ...], NAMES]
NATURAL = number(ge=0, whole=True)
Natural = Annotated[int, NATURAL]
COUNT = number(ge=1, whole=True)
Count = Annotated[int, COUNT]
POSITIVE = number(gt=0)
Positive = Annotated[float, POSITIVE]
Positives = tuple[Positive, ...]
Share = Annotated[float, number(gt=0, lt=1)]
Friction = Annotated[float, number(gt=0, le=2)]
"""Sliding coefficient."""
MASS = number(ge=1e-4, le=100)
"""kg: lighter bodies vanish in the solver's tolerance, heavier ones are no objects for a hand."""
Mass = Annotated[float, MASS]
TEXT = instance(str, "text")
NAMED = Rule("a name, or the path of a file", lambda value: TEXT.validate(os.fspath(value)))
CellFile = Annotated[str | None, NAMED, "--robot", "FILE|NAME", {"variable": "DEXGRASP_CELL"}]
"""Of a cell or of a robot alone, or a robot's name; None for the simulated cell. See `robot.cell.make_cell`."""
Mount = Annotated[str | None, "MOUNT"]
"""How the hand sits on the arm, by name; None for the robot's own."""

_PLAIN = {
    bool: instance(bool, "true or false"), int: number(whole=True), float: number(), str: TEXT,
    dict: instance(dict, "a mapping"), list: instance(list, "a list"), Path: Rule("a path", Path, Path),
}  # fmt: skip


class Hint(NamedTuple):
    """Parsed annotation of a field.

    Attributes:
        kind: its type, without `None` and `Annotated`.
        optional: whether None is valid.
        rule: what is valid; None where anything of the kind is taken as it is.
        marks: what else `Annotated` names.
    """

    kind: Any
    optional: bool
    rule: Rule | None
    marks: tuple[Any, ...]


@cache
def hints(kind: Any) -> dict[str, Hint]:
    """Return what the annotations of a dataclass say, by field."""
    found = get_type_hints(kind, include_extras=True)
    return {field.name: hint_of(found[field.name]) for field in fields(kind)}


def hint_of(annotation: Any) -> Hint:
    """Return what an annotation says."""
    optional = False
    marks: tuple[Any, ...] = ()
    while True:
        parts = get_args(annotation)
        if get_origin(annotation) is Annotated:
            annotation, marks = parts[0], parts[1:] + marks
        elif get_origin(annotation) in (Union, types.UnionType) and types.NoneType in parts:
            optional, annotation = True, reduce(or_, (part for part in parts if part is not types.NoneType))
        else:
            break
    rules = [mark for mark in marks if isinstance(mark, Rule)]
    rule = rules[-1] if rules else _PLAIN.get(get_origin(annotation) or annotation) or _of_each(annotation)
    return Hint(annotation, optional, rule, tuple(mark for mark in marks if not isinstance(mark, Rule)))


def _of_each(annotation: Any) -> Rule | None:
    """Return the rule of a few words, or of a tuple all of whose values have one rule."""
    if get_origin(annotation) is Literal:
        return one_of(get_args(annotation))
    parts = get_args(annotation) if get_origin(annotation) is tuple else ()
    rules = {hint_of(part).rule for part in parts if part is not Ellipsis}
    each = rules.pop() if len(rules) == 1 else None
    return each and several(each, None if Ellipsis in parts else len(parts))


def check(what: str, value: Any, rule: Rule) -> Any:
    """Return a value as its rule keeps it.

    Raises:
        InputError: one line that says what is wrong, `what` it is and what is valid.
    """
    try:
        return rule.validate(value)
    except InputError:
        raise
    except (AttributeError, TypeError, ValueError, OverflowError):
        raise InputError(f"{what} is {shortened(repr(value), 100)}: valid is {rule.words}") from None


def checked(function: Called) -> Called:
    """Hold the arguments of what users' programs call to its annotations: plain types, those with rules, and classes.

    Returns:
        The function, which raises `InputError` for an argument that is not as it says.
    """
    signature = inspect.signature(function)
    known = cache(
        lambda: {name: hint_of(each) for name, each in get_type_hints(function, None, None, True).items()}
    )

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        given = signature.bind(*args, **kwargs)
        for name, value in given.arguments.items():
            hint = known().get(name)
            if hint and not (value is None and hint.optional):
                rule = hint.rule or _of_class(hint.kind)
                given.arguments[name] = check(name, value, rule) if rule else value
        return function(*given.args, **given.kwargs)

    return cast(Called, call)


def read(kind: type[Settings], given: Any, what: str = "", *, more: bool = False) -> Settings:
    """Return a dataclass from a mapping of its fields, each of which is checked.

    Args:
        kind: the dataclass; fields that are dataclasses are read alike.
        given: the mapping, or one that is made already.
        what: it is, for messages; empty where the fields' names say enough.
        more: leave keys alone that are no fields, instead of refusing them.

    Raises:
        InputError: one line that names the field that is unknown, missing or wrong, and what is valid.
    """
    if isinstance(given, kind):
        return given
    known = hints(cast(Any, kind))
    if not isinstance(given, Mapping):
        raise InputError(f"{what or 'it'} is no mapping: valid is one with {', '.join(known)}")
    for key in given:
        if key not in known and not more:
            raise unknown_name(f"{what} key".strip(), key, known)
    values = {}
    for field in fields(cast(Any, kind)):
        name = f"{what} {field.name}".strip()
        if field.name in given:
            values[field.name] = _value(name, given[field.name], known[field.name], field.default, more)
        elif field.default is MISSING and field.default_factory is MISSING:
            raise InputError(f"{name} is missing")
    return kind(**values)


def check_fields(made: Any) -> None:
    """Check every field of a frozen dataclass by its rule; called in `__post_init__`, so that no way in is unchecked.

    Raises:
        InputError: as `read`.
    """
    for field in fields(made):
        value = getattr(made, field.name)
        kept = _value(field.name, value, hints(cast(Any, type(made)))[field.name], field.default, False)
        object.__setattr__(made, field.name, kept)


def refuse_idle(made: Any, needs: Mapping[str, tuple[bool, str]]) -> None:
    """Refuse fields of a dataclass that would change nothing.

    Args:
        made: the dataclass.
        needs: of fields that have an effect beside some others only: whether these are there, and which.

    Raises:
        InputError: naming the first of them, and what it needs.
    """
    for field in fields(made):
        met, need = needs.get(field.name, (True, ""))
        value = getattr(made, field.name)
        usual = field.default if field.default_factory is MISSING else field.default_factory()
        if not met and value != usual:
            raise InputError(f"{field.name}={value!r} changes nothing here: valid is {need}, or leave it out")


def _value(name: str, value: Any, hint: Hint, default: Any, more: bool) -> Any:
    if value is None and hint.optional:
        return None
    if value is None and is_dataclass(hint.kind) and default is not MISSING:
        return default
    if hint.rule is not None:
        return check(name, value, hint.rule)
    return read(cast(Any, hint.kind), value, name, more=more) if is_dataclass(hint.kind) else value
