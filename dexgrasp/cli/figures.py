"""Figures as tables for a terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

from dexgrasp.runs.text import text_table
from dexgrasp_env.arrays import Fields


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


def columns(figures: Fields) -> list[str]:
    """Return a line for each figure, all values below each other."""
    width = max(map(len, figures))
    return [f"{name:<{width}}  {shown(value)}" for name, value in figures.items()]


def record_table(rows: Sequence[Fields]) -> str:
    """Return records with the same keys as a table."""
    return text_table(tuple(rows[0]), [list(map(shown, row.values())) for row in rows], words=True)


def tables(figures: Fields) -> str:
    """Return nested figures as tables: the loose ones; mappings, those with the same keys as rows of one; records."""
    loose, groups = Fields(), dict[tuple[str, ...], list[Fields]]()
    parts = list[str]()
    for name, value in figures.items():
        if isinstance(value, Mapping):
            case = _flat(value)
            groups.setdefault(tuple(case), []).append({"": name.replace("_", " "), **case})
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            parts.append(f"{name}:\n{record_table(value)}")
        elif value != []:
            loose[name] = value
    if loose:
        groups[tuple(loose)] = [{"": "figure", **loose}]
    for keys, cases in groups.items():
        if len(cases) == 1:
            name = cases[0].pop("")
            cases = [{name: key.replace("_", " "), "value": value} for key, value in cases[0].items()]
        if keys:
            parts.append(record_table(cases))
    return "\n\n".join(parts)


def _flat(case: Mapping[str, Any], prefix: str = "") -> Fields:
    flat = Fields()
    for key, value in case.items():
        flat |= _flat(value, f"{prefix}{key} ") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return flat
