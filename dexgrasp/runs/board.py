"""TensorBoard, where it is installed."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any


class Board:
    """Writes numbers for TensorBoard; without tensorboard it writes nothing."""

    def __init__(self, folder: Path) -> None:
        self._writer: Any = None
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            return
        self._writer = SummaryWriter(str(folder))

    def add(self, row: Mapping[str, Any], step: int) -> None:
        """Write the numbers of a row, and those of a dict in it as name/split."""
        if self._writer is None:
            return
        for key, value in row.items():
            numbers = (
                {f"{name}/{key}": v for name, v in value.items()} if isinstance(value, dict) else {key: value}
            )
            for name, number in numbers.items():
                if isinstance(number, int | float):
                    self._writer.add_scalar(name, number, step)

    def close(self) -> None:
        """Write what is left."""
        if self._writer is not None:
            self._writer.close()
