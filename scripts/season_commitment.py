"""Contents of a season and of its commitment, and the entropy that its seeds are drawn with."""

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from beacon import CHAIN, randomness, round_time

from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.files import file_hash, jsonable, read_json_object, write_json

SCHEMAS = (1, 2)


@dataclass(frozen=True)
class Season:
    """Content of a season.

    Attributes:
        name: of the season, the file's stem.
        path: of the file.
        entries: settings of evaluations by name, with `seeds` (how many of each), a `title` and a `note` for readers.
    """

    name: str
    path: Path
    entries: Mapping[str, Mapping[str, Any]]

    @property
    def commitment(self) -> Path:
        """File of what was committed to."""
        return self.path.with_suffix(".commit.json")

    def folders(self, entry: str) -> list[str]:
        """Return the names of an entry's evaluations, one a seed.

        Raises:
            InputError: for an entry that there is not.
        """
        if entry not in self.entries:
            raise unknown_name(f"entry of season {self.name}", entry, self.entries)
        return [f"{entry}-{number}" for number in range(self.entries[entry].get("seeds", 1))]

    def settings(self, entry: str, seed: int = 0) -> EvaluationSettings:
        """Return an entry's settings.

        Raises:
            InputError: for settings that are none.
        """
        words = {
            key: value for key, value in self.entries[entry].items() if key not in ("seeds", "title", "note")
        }
        return EvaluationSettings.of(**words, seed=seed)

    def seeds(self, entropy: str) -> dict[str, tuple[str, int]]:
        """Return entry and seed of every evaluation by its folder: seeds are below 2^31, of commitment and entropy."""
        committed = file_hash(self.commitment)
        found = {}
        for entry in self.entries:
            for k, folder in enumerate(self.folders(entry)):
                digest = hashlib.sha256(f"{committed} {entropy} {entry} {k}".encode()).digest()
                found[folder] = entry, int.from_bytes(digest[:4], "big") >> 1
        return found


def read_season(path: Path) -> Season:
    """Read a season's file: of schema 2, or of schema 1, whose seeds came of a release's tag.

    Raises:
        InputError: if it is none.
    """
    content = read_json_object(path, "name a file of seasons/")
    entries = content.get("entries")
    known = isinstance(entries, dict) and all(isinstance(entry, dict) for entry in entries.values())
    if content.get("schema") not in SCHEMAS or not known:
        raise InputError(f"{path} is no season: it has schema {SCHEMAS[-1]} and entries by name")
    return Season(path.stem, path, entries)


def identities(season: Season, away: Collection[str] = ()) -> Fields:
    """Return what a season scores: its file, and of each entry the settings with the hashes of what they rest on.

    Entries `away` are left out.
    """
    return {
        "file": file_hash(season.path),
        "entries": {name: season.settings(name).identity() for name in season.entries if name not in away},
    }


def commit(path: Path, number: int | None, now: datetime, again: str | None = None) -> Path:
    """Write what a season commits to; return the file.

    Args:
        path: of the season.
        number: round of the beacon; None: entropy that is entered by hand.
        now: the time; a round must lie ahead of it.
        again: why it is committed to anew.

    Raises:
        InputError: for a round that is over, and where there is a commitment and no reason for another.
    """
    season = read_season(path)
    if number is not None and round_time(number) <= now:
        raise InputError(
            f"round {number} was {round_time(number):%Y-%m-%d %H:%M} UTC: name one that lies ahead, a round is 3 s"
        )
    before = read_json_object(season.commitment, "restore it from git") if season.commitment.is_file() else {}
    if before and not again:
        raise InputError(
            f"{season.commitment} is there: another commitment needs --again REASON, which it shows"
        )
    reasons = [*before.get("again", []), *([again] if again else [])]
    drawn = (
        {"round": number, "chain": CHAIN, "time": f"{round_time(number):%Y-%m-%d %H:%M:%S} UTC"}
        if number
        else None
    )
    write_json(season.commitment, {"schema": 1, "beacon": drawn, "again": reasons, **identities(season)})
    return season.commitment


def committed(season: Season, away: Collection[str] = ()) -> Fields:
    """Return what a season committed to, which is what is here, but for entries `away`.

    Raises:
        InputError: if it did not, or something is not as it was then.
    """
    if not season.commitment.is_file():
        raise InputError(
            f"{season.name} has no commitment: commit to it first (season.py commit {season.path})"
        )
    content = read_json_object(season.commitment, "restore it from git")
    now = jsonable(identities(season, away))
    for name, entry in now["entries"].items():
        then = content["entries"].get(name, {})
        if changed := [key for key in entry if entry[key] != then.get(key)]:
            raise InputError(f"{', '.join(changed)} of {name} is not as {season.commitment} says")
    if now["file"] != content["file"]:
        raise InputError(f"{season.path} is not as {season.commitment} says")
    return content


def entropy_of(beacon: Fields | None, signature: str | None, words: str | None) -> tuple[str, Fields]:
    """Return what seeds are drawn with, and what is recorded of it.

    Raises:
        InputError: if it is not what was committed to.
    """
    if beacon is None:
        if not words:
            raise InputError("this season has no beacon: give --entropy WORDS")
        return words, {"entropy": words, "checked": False}
    if not signature:
        raise InputError(f"give --signature HEX of round {beacon['round']}, of {beacon['time']}")
    return randomness(beacon["round"], signature), {"signature": signature, "checked": True}
