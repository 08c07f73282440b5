"""TensorBoard, where it is installed."""

from pathlib import Path
from typing import Any

from dexgrasp.runs.curves import Row, numbers


class Board:
    """Writes numbers for TensorBoard; without tensorboard it writes nothing."""

    def __init__(self, folder: Path) -> None:
        self._writer: Any = None
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            return
        self._writer = SummaryWriter(str(folder))

    def add(self, row: Row, step: int) -> None:
        """Write the numbers of a row, those of splits as name/split."""
        if self._writer is not None:
            for name, split, number in numbers(row):
                self._writer.add_scalar(f"{name}/{split}".rstrip("/"), number, step)

    def close(self) -> None:
        """Write what is left."""
        if self._writer is not None:
            self._writer.close()
