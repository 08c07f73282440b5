"""The epochs of a training: what is done in each, and kept after it."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dexgrasp.runs.board import Board
from dexgrasp.runs.interrupt import held
from dexgrasp_env.errors import InputError

Row = dict[str, Any]
_MEASURED = 20  # steps that tell how many epochs fit into the minutes


@dataclass
class Progress:
    """Where a training stands; `curve` has a row an epoch."""

    epoch: int = 0
    epochs: int = 0
    seconds: float = 0.0
    curve: list[Row] = field(default_factory=list)


def progress_of(note: Mapping[str, Any], path: Path) -> Progress:
    """Return the progress that the checkpoint at `path` notes.

    Raises:
        InputError: if it is none.
    """
    try:
        return Progress(**note)
    except TypeError:
        raise InputError(f"{path} is damaged: remove it to train from the start") from None


def run_epochs(
    state: Progress, folder: Path, learn: Callable[[], Row], keep: Callable[[], None],
    progress: Callable[[Any], None] | None, stop_after: int | None, judge: Callable[[], Row] | None = None,
) -> None:  # fmt: skip
    """Go on until all epochs are done.

    Args:
        state: filled as it goes.
        folder: of the training; `tensorboard/` in it is for TensorBoard.
        learn: does an epoch and returns its row.
        keep: writes the checkpoint.
        progress: called with `state` after every epoch.
        stop_after: epochs of this call, for tests of resuming.
        judge: called after every epoch, its time apart; what it returns joins the row.
    """
    board, calls = Board(folder / "tensorboard"), 0
    while state.epoch < state.epochs and calls != stop_after:
        began = time.perf_counter()
        row = {"epoch": state.epoch + 1} | learn()
        state.seconds += time.perf_counter() - began
        state.epoch, calls = state.epoch + 1, calls + 1
        if judge:
            row |= judge()
        state.curve.append(row)
        with held():
            keep()
        board.add(row, row.get("steps", state.epoch))
        if progress:
            progress(state)
    board.close()


def fitting_epochs(minutes: float, steps: int, step: Callable[[int], Any]) -> int:
    """Return how many epochs of `steps` fit into some minutes, measured; the caller drops what these steps learn."""
    step(0)
    began = time.perf_counter()
    for k in range(_MEASURED):
        step(k)
    each = (time.perf_counter() - began) / _MEASURED
    return max(1, int(60.0 * minutes / (1.05 * each * steps)))
