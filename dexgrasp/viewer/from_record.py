"""Films of grasp files and of the trials of an evaluation."""

from pathlib import Path

import numpy as np

from dexgrasp.grasp.file import read_grasp
from dexgrasp.grasp.record import APPROACH, LIFT, GraspRecord
from dexgrasp.viewer.film import Film, carried
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.scene.constants import CONTROL_PERIOD

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
    cell = record.check_cell()
    approach, lift = record.phase(APPROACH), record.phase(LIFT)
    pieces = {
        "approach": record.pregrasp[None] if approach is None else approach.setpoints,
        "close": _between(record.pregrasp, record.grasp),
        "squeeze": _between(record.grasp, record.squeeze),
        "lift": record.squeeze[None] if lift is None else lift.setpoints,
    }
    starts = np.cumsum([0, *(len(piece) for piece in pieces.values())])[:-1]
    states = np.concatenate(list(pieces.values()))
    pose = np.eye(4) if record.T_world_object is None else record.T_world_object
    model = None if record.T_world_object is None else record.object.load()
    return Film(
        title=record.object.name, cell=cell, states=states,
        object_poses=carried(states, int(starts[3]), pose, cell), period=CONTROL_PERIOD,
        segments=tuple(zip(pieces, (int(start) for start in starts), strict=True)), parts=record.parts,
        contacts=record.points, normals=record.normals, forces=record.forces,
        fingers=record.fingers,
        friction=record.thresholds.friction, object=model, cloud=np.zeros((0, 3)) if cloud is None else cloud,
        facts=_facts(record),
    )  # fmt: skip


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


def _between(a: Array, b: Array) -> Array:
    return a + np.linspace(0.0, 1.0, _CLOSING)[:, None] * (b - a)


def _facts(record: GraspRecord) -> dict[str, str]:
    c = record.certificate
    return {
        "planned by": record.agent or "unknown",
        "fingertip distances, cm": ", ".join(f"{d:.2f}" for d in c.distances_cm),
        "closure margin": f"{c.closure_margin:.2f}",
        "load, weights": f"{c.load:.2f}",
        "assumed mass, g": f"{1000 * c.mass:.0f}",
        "least clearance, mm": f"{1000 * c.min_clearance_m:.1f}",
        "joint torque over limit": f"{c.max_joint_torque_fraction:.2f}",
        "holds": str(c.holds),
    }
