"""The cell of the process: what is not given one by `robot=` takes it."""

import os
from functools import lru_cache

from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand
from dexgrasp_env.robot.cell import Cell, make_cell

VARIABLE = "DEXGRASP_CELL"


@lru_cache(maxsize=1)
def active_cell() -> Cell:
    """Return the cell of this process; from the first call on it stays."""
    return make_cell(os.environ.get(VARIABLE))


def use_cell(path: str | os.PathLike[str]) -> Cell:
    """Choose the cell of this process and of those that it starts.

    Raises:
        InputError: for a file that is no cell, or where another cell is in use already.
    """
    cell = make_cell(path)
    if active_cell.cache_info().currsize and active_cell() != cell:
        raise InputError(
            f"cell {active_cell().name!r} is in use in this process: choose before anything is made, or set {VARIABLE}"
        )
    os.environ[VARIABLE] = str(expand(path).resolve())
    return active_cell()


def of_process(cell: Cell | str | None) -> Cell:
    """Return a cell that is given, or the process's with a mount of that name."""
    return cell if isinstance(cell, Cell) else active_cell().mounted(cell)
