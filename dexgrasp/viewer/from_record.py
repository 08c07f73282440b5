"""Films of grasp files."""

import numpy as np

from dexgrasp.grasp.record import GraspRecord
from dexgrasp.viewer.film import Film, carried
from dexgrasp_env.arrays import Array

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
    script = record.script
    ways = (
        [phase.setpoints for phase in script.phases]
        if script
        else [record.pregrasp[None], record.squeeze[None]]
    )
    before = [
        ways[0],
        np.linspace(record.pregrasp, record.grasp, _CLOSING),
        np.linspace(record.grasp, record.squeeze, _CLOSING),
    ]
    states = np.concatenate([*before, ways[1]])
    poses = carried(states, sum(map(len, before)), np.eye(4) if pose is None else pose, cell)
    model = None if pose is None else record.object.load()
    return Film(record, states, poses, model, cloud)
