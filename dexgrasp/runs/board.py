"""TensorBoard, where it is installed."""

from pathlib import Path
from typing import Any

from dexgrasp.runs.curves import Row, numbers


class Board:
    """Writes numbers for TensorBoard, from the first row on; without tensorboard it writes nothing."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._writer: Any = None

    def add(self, row: Row, step: int) -> None:
        """Write the numbers of a row, those of splits as name/split."""
        self._writer = self._writer or _writer(self._folder)
        if self._writer is not None:
            for name, split, number in numbers(row):
                self._writer.add_scalar(f"{name}/{split}".rstrip("/"), number, step)

    def close(self) -> None:
        """Write what is left."""
        if self._writer is not None:
            self._writer.close()


def _writer(folder: Path) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(folder))
