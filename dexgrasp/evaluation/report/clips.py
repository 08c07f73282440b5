"""Clips of failures in the page: what `evaluate --video failures` recorded."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from dexgrasp.evaluation.reasons import sentence
from dexgrasp.evaluation.replay import video_path
from dexgrasp.evaluation.store import read_rows

_MOST = 24
_LARGEST = 12_000_000
"""Bytes of clips that one page may hold: base64 makes a third more of it, and mail servers stop at 20 MB."""


class Clips(NamedTuple):
    """What is said of the clips, and (mp4 file, caption) of each that is shown."""

    words: str
    shown: list[tuple[Path, str]]


def clips(folders: Sequence[Path]) -> Clips:
    """Return the clips of failures that are there, the first of each agent, object and protocol first."""
    failed = [(folder, row) for folder in folders for row in read_rows(folder) if not row["success"]]
    paths = [(video_path(folder, row), row) for folder, row in failed]
    there = sorted((pair for pair in paths if pair[0].is_file()), key=lambda pair: _rank(pair[1]))
    shown = []
    size = 0
    for path, row in there[:_MOST]:
        size += path.stat().st_size
        if size > _LARGEST:
            break
        shown.append((path, _caption(row)))
    more = f" {len(there) - len(shown)} more are in videos/." if len(there) > len(shown) else ""
    return Clips(f"{len(shown)} of {len(failed)} failures.{more}", shown)


def _rank(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["trial"], row["agent"] != "bilevel", row.get("protocol") or "", row["object"]


def _caption(row: Mapping[str, Any]) -> str:
    protocol = f", {row['protocol']}" if row.get("protocol") else ""
    return f"{row['agent']}: {row['object']}{protocol}, trial {row['trial']}: {sentence(row['reason'] or '')}"
