"""A grasp file as a trajectory with what a robot's programmer has to know of it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np

from dexgrasp.export.formats import write_csv, write_json, write_ros2, write_scene
from dexgrasp.export.trajectory import Waypoints, make_trajectory
from dexgrasp.grasp.record import GraspRecord
from dexgrasp.mechanics.kinematics.forward import hand_contact_jacobian
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand, jsonable
from dexgrasp_env.objects.model import ObjectModel, centred_model
from dexgrasp_env.objects.parts import hull_part
from dexgrasp_env.poses import matrix_to_quat, placed, rigid
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.valid import Positive, checked, one_of

_PRESSING = (
    "each of these presses in full, so send one: `closed` to the servos that were planned with, or `touching` plus "
    "`offset` to servos of `stiffness`, or `touching` to a soft servo with `torque` as effort"
)


@checked
def export_grasp(
    record: GraspRecord,
    folder: str | Path,
    kind: Annotated[str, one_of(("csv", "json", "ros2", "mjcf"))],
    stiffness: Positive | None = None,
    rejected: Sequence[str] = (),
) -> list[Path]:
    """Write a grasp's trajectory, or its scene, into a folder.

    Args:
        record: of a grasp file.
        folder: made if it is not there.
        kind: of the files; `mjcf` and `ros2` have the csv beside them, so that it can be checked and, with a scene,
            replayed. Where only a cloud was seen, the scene's object is what was planned on.
        stiffness: Nm/rad of the hand's joint servos, for the squeeze as position offsets; None for the cell's.
        rejected: checks that the grasp fails, which the files are to say.

    Returns:
        The files.

    Raises:
        InputError: for an unknown format, a file without approach and lift, ways that cannot be timed within the
            limits, or a mesh that is not here any more.
    """
    cell, folder = record.check_cell(), expand(folder)
    stiffness = cell.robot.hand.joints.stiffness[0] if stiffness is None else stiffness
    if record.script is None:
        raise InputError(
            "this grasp file has no approach and no lift: plan it again with `dexgrasp plan --out`"
        )
    approach, lift, *placing = (phase.setpoints for phase in record.script.phases)
    way = Waypoints(approach, record.grasp, record.squeeze, lift, tuple(placing))
    trajectory, facts = make_trajectory(way, cell.robot), grasp_facts(record, cell, stiffness)
    facts["rejected"] = list(rejected)
    if kind == "json":
        return write_json(folder, trajectory, facts)
    scene = _scene(record, cell, folder) if kind == "mjcf" else []
    messages = write_ros2(folder, trajectory, facts) if kind == "ros2" else []
    return [*scene, *messages, *write_csv(folder, trajectory, facts)]


def grasp_facts(record: GraspRecord, cell: Cell, stiffness: float) -> Fields:
    """Return what the files say beside the rows: postures, palm, the squeeze; positions from the robot's base."""
    tree, hand, T = robot_tree(cell), slice(cell.robot.arm_dof, None), cell.T_base_world
    palm = T @ rigid(*palm_frame(record.q, tree))
    J = hand_contact_jacobian(record.grasp, record.points, record.normals, tree)
    torque = np.einsum("frj,fr->j", J, record.forces)  # presses with the planned forces
    # Each servo has its share where others follow it.
    torque = cell.robot.drive[0][hand, hand] @ (cell.robot.stiffness[hand] / tree.stiffness * torque)
    return jsonable({
        "object": record.object.name,
        "mount": record.mount,
        "cell": cell.stamp,
        "open": record.pregrasp[hand],
        "touching": record.grasp[hand],
        "closed": record.squeeze[hand],
        "pressing": _PRESSING,
        "palm": {"position": palm[:3, 3], "quat_wxyz": matrix_to_quat(palm[:3, :3])},
        "squeeze": {
            "joints": cell.robot.hand.joints.names,
            "torque": torque,
            "stiffness": stiffness,
            "offset": torque / stiffness,
        },
        "contacts": {
            "fingers": record.fingers,
            "points": placed(T, record.points),
            "forces": record.forces[:, :3] @ T[:3, :3].T,
        },
        "largest_force": np.linalg.norm(record.forces[:, :3], axis=1).max(),
        "quality": record.certificate.closure_margin,
        "lift_height": 0.0 if record.script is None else record.script.lift_height,
        "parts": [placed(T, part) for part in record.parts],
        "around": [placed(T, part) for part in record.neighbour_parts],
        "up": T[:3, 2],
        "any_heading": record.goal is not None and record.goal.yaw is None,
        "placed": None if record.goal is None else T @ _set_down(record, cell) @ cell.T_world_base,
        "table": record.table,
        "note": "open loop: nothing here reacts to what the fingers meet; certified, where it is, is the grasp alone",
    })  # fmt: skip


def _set_down(record: GraspRecord, cell: Cell) -> Array:
    """Return the motion (4, 4) of the object from where it lies to where it is let go of, world frame."""
    assert record.script is not None
    lift, _, lowering, *_ = record.script.phases[1:]
    first, last = (
        rigid(*palm_frame(q, robot_tree(cell))) for q in (lift.setpoints[0], lowering.setpoints[-1])
    )
    return last @ np.linalg.inv(first)


def _scene(record: GraspRecord, cell: Cell, folder: Path) -> list[Path]:
    model, pose = record.object.load(), record.T_world_object
    if model is None or pose is None:
        model, pose = _seen(record)
    return write_scene(folder, model, pose, cell, record.neighbour_parts)


def _seen(record: GraspRecord) -> tuple[ObjectModel, Array]:
    """Return the object that was planned on, and its pose: unknown where only a cloud was seen."""
    import trimesh

    from dexgrasp_env.objects.shapes import union

    hulls = [trimesh.Trimesh(part, process=False).convex_hull for part in record.parts]
    mesh = hulls[0] if len(hulls) == 1 else union(hulls)
    pose = rigid(np.eye(3), mesh.center_mass)
    parts = [hull_part(part) for part in record.parts]
    return centred_model(record.object.name, mesh, parts, record.certificate.mass), pose
