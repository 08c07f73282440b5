"""What a viewer shows of a grasp: states of robot and object over time, contacts, forces, and the certificate."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dexgrasp.kinematics.palm_ik import palm_frame
from dexgrasp.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.robot.cell import Cell


@dataclass(frozen=True, eq=False)
class Film:
    """One grasp as it would be carried out. NB: kinematic, with the object fixed to the palm in the lift.

    Attributes:
        title: one line.
        cell: with the mount in use.
        states: (T, n) rad.
        object_poses: (T, 4, 4) m, world frame.
        period: s between states.
        segments: names and first states.
        object: the true object where it is known, else None.
        parts: (V, 3) m of each convex part that was planned on, in the world frame.
        cloud: (N, 3) m that was seen; may be empty.
        contacts, normals, forces: (N, 3) m, unit out of the object, N on the object.
        fingers: whose tips make the contacts.
        friction: of the cones that are drawn.
        facts: name -> value, shown beside the scene.
    """

    title: str
    cell: Cell
    states: Array
    object_poses: Array
    period: float
    segments: tuple[tuple[str, int], ...]
    parts: tuple[Array, ...]
    contacts: Array
    normals: Array
    forces: Array
    fingers: tuple[str, ...]
    friction: float
    object: ObjectModel | None = None
    cloud: Array = field(default_factory=lambda: np.zeros((0, 3)))
    facts: dict[str, str] = field(default_factory=dict)


def carried(states: Array, first_lifted: int, T_world_object: Array, cell: Cell) -> Array:
    """Return object poses (T, 4, 4) that rest until a state and then move with the palm.

    Args:
        states: (T, n) rad.
        first_lifted: from this state on the object moves with the palm.
        T_world_object: (4, 4) where it rests.
        cell: with the mount in use.
    """
    palms = palm_poses(states, cell)
    poses = np.tile(np.asarray(T_world_object, dtype=float), (len(states), 1, 1))
    at = min(first_lifted, len(states) - 1)
    in_palm = np.linalg.inv(palms[at]) @ T_world_object
    poses[at:] = palms[at:] @ in_palm
    return poses


def palm_poses(states: Array, cell: Cell) -> Array:
    """Return the palm's poses (T, 4, 4) in the world frame."""
    poses, tree = np.tile(np.eye(4), (len(states), 1, 1)), robot_tree(cell)
    for pose, q in zip(poses, states, strict=True):
        pose[:3, :3], pose[:3, 3] = palm_frame(q, tree)
    return poses


def robot_model(cell: Cell) -> tuple[Any, Any]:
    """Return the robot alone: model and data."""
    import mujoco

    from dexgrasp_env.robot.model import compiled_robot

    model = compiled_robot(cell)
    return model, mujoco.MjData(model)
