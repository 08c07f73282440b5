"""Playback of a grasp file: states of robot and object over time, the points seen, and texts beside them."""

from dataclasses import dataclass

import numpy as np

from dexgrasp.grasp.certificate import figures_of
from dexgrasp.grasp.record import GraspRecord
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.poses import rigid
from dexgrasp_env.robot.cell import Cell


@dataclass(frozen=True, eq=False)
class GraspPlayback:
    """One grasp as it would be carried out. NB: kinematic, with the object fixed to the palm while it is held.

    Attributes:
        record: of the grasp.
        states: (T, n) rad, one a control period.
        object_poses: (T, 4, 4) m, world frame.
        object: the true object where it is known, else None.
        cloud: (N, 3) m that was seen, where it is to be shown.
    """

    record: GraspRecord
    states: Array
    object_poses: Array
    object: ObjectModel | None = None
    cloud: Array | None = None

    @property
    def title(self) -> str:
        """The object's name."""
        return self.record.object.name

    @property
    def facts(self) -> dict[str, str]:
        """Texts beside the scene, by name: agent, table, figures of the certificate."""
        record = self.record
        table = {} if record.table is None else {"table, as seen": str(record.table)}
        return {"planned by": record.agent or "unknown"} | table | figures_of(record.certificate.as_json())


def playback_of(record: GraspRecord, cloud: Array | None = None) -> GraspPlayback:
    """Return the playback of a grasp: approach, close, squeeze, lift, and with a goal all until the hand has left.

    Args:
        record: of a grasp file; one without approach and lift shows closing alone.
        cloud: (N, 3) m that was seen, if it is to be shown.

    Raises:
        InputError: for a grasp of another cell, or one whose object is not here.
    """
    cell, pose = record.check_cell(), record.T_world_object
    approach, lift, *placing = record.pregrasp[None], record.squeeze[None]
    if record.script is not None:
        approach, lift, *placing = (phase.setpoints for phase in record.script.phases)
    closing = np.linspace(record.pregrasp, record.grasp, 12)
    pressing = np.linspace(record.grasp, record.squeeze, 12)
    held = [lift, *placing[:2]]  # carried and set down as well
    states = np.concatenate([approach, closing, pressing, *held, *placing[2:]])
    start = np.eye(4) if pose is None else pose
    palms, first = palm_poses(states, cell), len(approach) + len(closing) + len(pressing)
    last = first + sum(map(len, held))
    poses = np.tile(start, (len(states), 1, 1))
    poses[first:last] = palms[first:last] @ np.linalg.inv(palms[first]) @ start
    poses[last:] = poses[last - 1]
    model = None if pose is None else record.object.load()
    return GraspPlayback(record, states, poses, model, cloud)


def palm_poses(states: Array, cell: Cell) -> Array:
    """Return the palm's poses (T, 4, 4) in the world frame."""
    return np.stack([rigid(*palm_frame(q, robot_tree(cell))) for q in states])
