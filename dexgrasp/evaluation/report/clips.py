"""Clips of failures in the page: what `evaluate --video failures` recorded."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.reasons import sentence
from dexgrasp.evaluation.replay import video_path
from dexgrasp.evaluation.report.document import Block, Clip, ClipsBlock, Heading, Paragraph
from dexgrasp.evaluation.store import read_rows

_MOST = 24
_LARGEST = 12_000_000
"""Bytes of clips that one page may hold: base64 makes a third more of it, and mail servers stop at 20 MB."""


def clip_blocks(folders: Sequence[Path]) -> list[Block]:
    """Return the clips of failures that are there, the first of each agent, object and protocol first."""
    failed = [(folder, row) for folder in folders for row in read_rows(folder) if not row["success"]]
    paths = [(video_path(folder, row), row) for folder, row in failed]
    there = sorted((pair for pair in paths if pair[0].is_file()), key=lambda pair: _rank(pair[1]))
    clips: list[Clip] = []
    size = 0
    for path, row in there[:_MOST]:
        size += path.stat().st_size
        if size > _LARGEST:
            break
        clips.append(Clip(path, _caption(row)))
    if not clips:
        return []
    more = f" {len(there) - len(clips)} more are in videos/." if len(there) > len(clips) else ""
    words = f"{len(clips)} of {len(failed)} failures.{more}"
    return [Heading("Failures, as clips"), Paragraph(words), ClipsBlock(clips)]


def _rank(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["trial"], row["agent"] != "bilevel", row.get("protocol") or "", row["object"]


def _caption(row: Mapping[str, Any]) -> str:
    protocol = f", {row['protocol']}" if row.get("protocol") else ""
    return f"{row['agent']}: {row['object']}{protocol}, trial {row['trial']}: {sentence(row['reason'] or '')}"
