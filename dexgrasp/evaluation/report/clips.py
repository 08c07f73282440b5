"""Clips of failures in the page: what `evaluate --video failures` recorded."""

from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

from dexgrasp.evaluation.reasons import sentence
from dexgrasp.evaluation.replay import video_path
from dexgrasp.evaluation.store import failed_or_disturbed, read_rows
from dexgrasp_env.arrays import Fields

_MOST = 24
_LARGEST = 12_000_000
"""Bytes of clips that one page may hold: base64 makes a third more of it, and mail servers stop at 20 MB."""


class Clips(NamedTuple):
    """Return the words beside the clips, and (mp4 file, caption) of each that is shown."""

    words: str
    shown: list[tuple[Path, str]]


def clips(folders: Sequence[Path]) -> Clips:
    """Return the clips of failures that are there, the first of each agent, object and protocol first."""
    failed = [
        (row, video_path(folder, row))
        for folder in folders
        for row in read_rows(folder)
        if failed_or_disturbed(row)
    ]
    there = sorted(((row, path) for row, path in failed if path.is_file()), key=lambda pair: _rank(pair[0]))
    sizes = accumulate(path.stat().st_size for _, path in there[:_MOST])
    shown = [
        (path, _caption(row)) for (row, path), size in zip(there, sizes, strict=False) if size <= _LARGEST
    ]
    more = f" {len(there) - len(shown)} more are in videos/." if len(there) > len(shown) else ""
    return Clips(f"{len(shown)} of {len(failed)} failures.{more}", shown)


def _rank(row: Fields) -> tuple[Any, ...]:
    return row["trial"], row["agent"] != "bilevel", row["protocol"], row["object"]


def _caption(row: Fields) -> str:
    why = sentence(row["reason"]) if row["reason"] else "lifted"
    hit = f"; hit {', '.join(row['hit_names'])}" if row.get("hit_names") else ""
    moved = f"; moved a neighbour by {100 * row['moved']:.0f} cm" if row.get("clean") is False else ""
    return f"{row['agent']}: {row['object']}, {row['protocol']}, trial {row['trial']}: {why}{hit}{moved}"
