"""A grasp file as a trajectory with what a robot's programmer has to know of it."""

from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.export.formats import write_csv, write_json, write_ros2
from dexgrasp.export.scene_folder import write_scene
from dexgrasp.export.trajectory import Trajectory, Waypoints, make_trajectory
from dexgrasp.grasp.record import GraspRecord
from dexgrasp.kinematics.forward import body_frames, tip_jacobian
from dexgrasp.kinematics.tree import robot_tree
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.objects.model import ObjectModel, centred_model
from dexgrasp_env.objects.parts import hull_part
from dexgrasp_env.poses import matrix_to_quat
from dexgrasp_env.robot.active import active_cell
from dexgrasp_env.robot.limits import HAND_STIFFNESS
from dexgrasp_env.robot.names import HAND_JOINTS
from dexgrasp_env.scene.constants import FRICTION

FORMATS = ("csv", "json", "ros2", "mjcf")


def export_grasp(record: GraspRecord, folder: Path, kind: str, stiffness: float | None = None) -> list[Path]:
    """Write a grasp's trajectory, or its scene, into a folder.

    Args:
        record: of a grasp file.
        folder: made if it is not there.
        kind: one of `FORMATS`; `mjcf` and `ros2` have the csv beside them, so that it can be checked and, with a scene,
            replayed. Where only a cloud was seen, the scene's object is what was planned on.
        stiffness: Nm/rad of the hand's joint servos, for the squeeze as position offsets; None for the cell's.

    Returns:
        The files.

    Raises:
        InputError: for an unknown format, a file without approach and lift, or a mesh that is not here any more.
    """
    if kind not in FORMATS:
        raise unknown_name("format", kind, FORMATS)
    stiffness = HAND_STIFFNESS if stiffness is None else stiffness
    if not (np.isfinite(stiffness) and stiffness > 0.0):
        raise InputError(f"stiffness is {stiffness}: valid is a positive number of Nm/rad")
    record.check_cell()
    trajectory, facts = trajectory_of(record), grasp_facts(record, stiffness)
    folder.mkdir(parents=True, exist_ok=True)
    if kind == "json":
        return write_json(folder, trajectory, facts)
    scene = _scene(record, folder) if kind == "mjcf" else []
    messages = write_ros2(folder, trajectory, facts) if kind == "ros2" else []
    return [*scene, *messages, *write_csv(folder, trajectory, facts)]


def trajectory_of(record: GraspRecord) -> Trajectory:
    """Return the timed trajectory of a grasp file.

    Raises:
        InputError: if the file has no approach and no lift, or they cannot be timed within the limits.
    """
    approach, lift = record.phase("approach"), record.phase("lift")
    if approach is None or lift is None:
        raise InputError(
            "this grasp file has no approach and no lift: plan it again with `dexgrasp plan --out`"
        )
    motion = record.grasp.motion
    return make_trajectory(Waypoints(approach.setpoints, motion.grasp, motion.squeeze, lift.setpoints))


def grasp_facts(record: GraspRecord, stiffness: float) -> dict[str, Any]:
    """Return what the files say beside the rows: postures, palm, the squeeze; positions from the robot's base."""
    torque, base, grasp = _torque(record), active_cell().base, record.grasp
    tree = robot_tree(grasp.mount)
    R, p = body_frames(grasp.q, tree)
    palm_R, palm_p = R[tree.palm] @ tree.palm_rotation, p[tree.palm] + R[tree.palm] @ tree.palm_offset
    return {
        "object": record.object.name,
        "mount": grasp.mount,
        "cell": active_cell().stamp,
        "open": grasp.motion.pregrasp[7:].tolist(),
        "closed": grasp.motion.squeeze[7:].tolist(),
        "palm": {"position": (palm_p - base).tolist(), "quat_wxyz": matrix_to_quat(palm_R).tolist()},
        "squeeze": {
            "joints": list(HAND_JOINTS),
            "torque": torque.tolist(),
            "stiffness": stiffness,
            "offset": (torque / stiffness).tolist(),
        },
        "contacts": {"fingers": list(grasp.fingers), "points": (grasp.contacts - base).tolist(),
                     "forces": grasp.forces.tolist()},
        "largest_force": float(np.linalg.norm(grasp.forces, axis=1).max()),
        "quality": grasp.certificate.closure_margin,
        "lift_height": grasp.motion.lift_height,
        "hull": (record.hull - base).tolist(),
        "part_sizes": None if len(record.parts) == 1 else [len(part) for part in record.parts],
        "note": "open loop: nothing here reacts to what the fingers meet; certified, where it is, is the grasp alone",
    }  # fmt: skip


def _torque(record: GraspRecord) -> Array:
    """Joint torques (16,) Nm that press with the planned forces, J^T f at the contact points."""
    grasp, tree = record.grasp, robot_tree(record.grasp.mount)
    J = tip_jacobian(tree, body_frames(grasp.motion.grasp, tree), grasp.contacts)[:, :, 7:]
    return np.asarray(np.einsum("frj,fr->j", J, grasp.forces))


def _scene(record: GraspRecord, folder: Path) -> list[Path]:
    model, pose = record.object.load(), record.T_world_object
    if model is None or pose is None:
        model, pose = _seen(record)
    return write_scene(folder, model, pose, record.grasp.mount, FRICTION)


def _seen(record: GraspRecord) -> tuple[ObjectModel, Array]:
    """What was planned on as an object, and its pose: where only a cloud was seen, nobody knows more."""
    import trimesh

    from dexgrasp_env.objects.shapes import union

    hulls = [trimesh.Trimesh(part, process=False).convex_hull for part in record.parts]
    mesh, pose = hulls[0] if len(hulls) == 1 else union(hulls), np.eye(4)
    pose[:3, 3] = mesh.center_mass
    parts = [hull_part(part) for part in record.parts]
    return centred_model(record.object.name, mesh, parts, record.mass), pose
