"""Films of grasp files and of the trials of an evaluation."""

from pathlib import Path

import numpy as np

from dexgrasp.grasp.file import read_grasp
from dexgrasp.grasp.record import APPROACH, LIFT, GraspRecord
from dexgrasp.viewer.film import Film, carried
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell

MOST_TRIALS = 6
"""Trials of a run that are shown side by side."""
_CLOSING = 12  # states from open to closed, and from closed to pressing


def film_of(record: GraspRecord, cloud: Array | None = None) -> Film:
    """Return the film of a grasp: approach, close, squeeze, lift.

    Args:
        record: of a grasp file; one without approach and lift shows closing alone.
        cloud: (N, 3) m that was seen, if it is to be shown.

    Raises:
        InputError: for a grasp of another cell, or one whose object is not here.
    """
    cell, pose = record.check_cell(), record.T_world_object
    approach, lift = record.phase(APPROACH), record.phase(LIFT)
    before = [
        record.pregrasp[None] if approach is None else approach.setpoints,
        np.linspace(record.pregrasp, record.grasp, _CLOSING),
        np.linspace(record.grasp, record.squeeze, _CLOSING),
    ]
    states = np.concatenate([*before, record.squeeze[None] if lift is None else lift.setpoints])
    poses = carried(states, sum(map(len, before)), np.eye(4) if pose is None else pose, cell)
    model = None if pose is None else record.object.load()
    return Film(record, states, poses, model, cloud)


def films_of_run(folder: Path, cell: Cell | None = None) -> list[Film]:
    """Return the films of the trials of an evaluation whose grasps were kept, failures first, a few at most.

    Raises:
        InputError: if there are none.
    """
    files = sorted((folder / "grasps").glob("*.json"))[:MOST_TRIALS] if folder.is_dir() else []
    if not files:
        raise InputError(
            f"{folder} holds no grasps: name the --out of `dexgrasp evaluate` with an agent that plans"
        )
    return [film_of(read_grasp(file, cell)) for file in files]
