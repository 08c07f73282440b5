"""Tables of cases: tests/data/*.yaml."""

from functools import cache
from pathlib import Path

import yaml

DATA = Path(__file__).parent / "data"


@cache
def _read(file):
    return yaml.safe_load((DATA / f"{file}.yaml").read_text())


def table(name, file="cases"):
    """Return a table by its name."""
    return _read(file)[name]


def mistakes(what):
    """Return rows of what users do wrong, and words that they are told, by what it is done to."""
    return _read("mistakes")[what]
