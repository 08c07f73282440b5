"""Figures as tables for a terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

from dexgrasp.runs.text import left_table


def shown(value: Any) -> str:
    """Return a value as people read it, a figure in a few digits."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e5 else f"{value:.0f}"
    if isinstance(value, Mapping):
        return ", ".join(f"{key}={shown(part)}" for key, part in value.items()) or "-"
    if isinstance(value, list | tuple):
        return ", ".join(map(shown, value))
    return "-" if value is None else str(value)


def columns(figures: Mapping[str, str]) -> list[str]:
    """Return a line for each figure, all values below each other."""
    width = max(map(len, figures))
    return [f"{name:<{width}}  {value}" for name, value in figures.items()]


def record_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return records with the same keys as a table."""
    return left_table(tuple(rows[0]), [list(map(shown, row.values())) for row in rows])


def tables(figures: Mapping[str, Any]) -> str:
    """Return nested figures as tables: the loose ones; mappings, those with the same keys as rows of one; records."""
    loose, groups = dict[str, Any](), dict[tuple[str, ...], list[dict[str, Any]]]()
    parts = []
    for name, value in figures.items():
        if isinstance(value, Mapping):
            case = _flat(value)
            groups.setdefault(tuple(case), []).append({"": name.replace("_", " "), **case})
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            parts.append(f"{name}:\n{record_table(value)}")
        else:
            loose[name] = value
    for keys, cases in groups.items():
        if len(cases) > 1:
            parts.append(record_table(cases))
        elif keys:
            parts.append(_columns(cases[0].pop(""), cases[0]))
    return "\n\n".join([*parts, *([_columns("figure", loose)] if loose else [])])


def _columns(name: str, case: Mapping[str, Any]) -> str:
    return left_table((name, "value"), [[key.replace("_", " "), shown(value)] for key, value in case.items()])


def _flat(case: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in case.items():
        flat |= _flat(value, f"{prefix}{key} ") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return flat
