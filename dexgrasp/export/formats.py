"""Trajectories as files: CSV, JSON, and ROS 2 messages as YAML, written without ROS; their scene as MJCF."""

import json
import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from dexgrasp.export.trajectory import ARM_TICK, HAND_EVERY, Trajectory
from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.assets import asset_path
from dexgrasp_env.files import write_atomically
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.poses import matrix_to_quat
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.scene.build import scene_spec
from dexgrasp_env.valid import Names

SCHEMA = 1
SCENE, MESHES = "scene.xml", "meshes"


def write_csv(folder: Path, trajectory: Trajectory, facts: Fields) -> list[Path]:
    """Write `arm.csv` (1 kHz), `hand.csv` (333 Hz), s and rad with 17 digits, and `segments.json` with the rest."""
    return [
        *(
            _write(folder / f"{name}.csv", _table(joints, period, rows))
            for name, joints, period, rows in _parts(trajectory)
        ),
        _write(folder / "segments.json", json.dumps(_head(trajectory, facts), indent=1)),
    ]


def write_json(folder: Path, trajectory: Trajectory, facts: Fields) -> list[Path]:
    """Write `trajectory.json`: names, units, segments, the squeeze, and the rows of arm and hand."""
    content = _head(trajectory, facts) | {
        name: {"joints": list(joints), "period": period, "positions": rows.tolist()}
        for name, joints, period, rows in _parts(trajectory)
    }
    return [_write(folder / "trajectory.json", json.dumps(content))]


def write_ros2(folder: Path, trajectory: Trajectory, facts: Fields) -> list[Path]:
    """Write `arm.yaml` and `hand.yaml` (trajectory_msgs/JointTrajectory) and `grasp.yaml` (moveit_msgs/Grasp)."""
    base = trajectory.robot.arm.bodies[0]
    messages = {"grasp": moveit_grasp(facts, base, trajectory.robot.hand.joints.names)}
    for name, joints, period, rows in _parts(trajectory):
        # Rows to a point of a ROS trajectory: its controllers interpolate
        every = {"arm": 10, "hand": 5}[name]
        resting = np.repeat(rows[-1:], -(len(rows) - 1) % every, axis=0)  # the last point is the last row
        thinned = np.concatenate([rows, resting])[::every]
        messages[name] = joint_trajectory(joints, thinned, period * every, base)
    return [_write(folder / f"{name}.yaml", _yaml(content)) for name, content in messages.items()]


def _parts(trajectory: Trajectory) -> Iterator[tuple[str, Names, float, Array]]:
    """Yield name, joints, period in s and rows of what each controller takes."""
    robot = trajectory.robot
    yield "arm", robot.arm.joints.names, ARM_TICK, trajectory.arm
    yield "hand", robot.hand.joints.names, ARM_TICK * HAND_EVERY, trajectory.hand


def joint_trajectory(joints: Names, rows: Array, period: float, base: str) -> Fields:
    """Return a trajectory_msgs/JointTrajectory: positions (T, n) rad with velocities by central differences."""
    velocities = np.gradient(rows, period, axis=0) if len(rows) > 1 else np.zeros_like(rows)
    velocities[0] = velocities[-1] = 0.0
    both = enumerate(zip(rows.tolist(), velocities.tolist(), strict=True))
    return _trajectory(base, joints, [_point(k * period, q, v) for k, (q, v) in both])


def moveit_grasp(facts: Fields, base: str, joints: Names) -> Fields:
    """Return a moveit_msgs/Grasp; `grasp_pose` is of the palm frame in the robot base frame."""
    palm = facts["palm"]

    def posture(hand: list[float], torque: Sequence[float] = ()) -> Fields:
        """Return a `trajectory_msgs/JointTrajectory` of one point."""
        return _trajectory(base, joints, [_point(0.0, hand, effort=torque)])

    def translation(way: float, distance: float) -> Fields:
        """Return a `GripperTranslation` off the table (1) or onto it (-1), m."""
        vector = {
            axis: way * part + 0.0 for axis, part in zip("xyz", facts.get("up", (0.0, 0.0, 1.0)), strict=True)
        }
        return {
            "direction": {"header": _header(base), "vector": vector},
            "desired_distance": distance,
            "min_distance": 0.5 * distance,
        }

    return {
        "id": facts["object"],
        "pre_grasp_posture": posture(facts["open"]),
        "grasp_posture": posture(facts["closed"], facts["squeeze"]["torque"]),
        "grasp_pose": {
            "header": _header(base),
            "pose": {
                "position": dict(zip("xyz", palm["position"], strict=True)),
                "orientation": dict(zip("wxyz", palm["quat_wxyz"], strict=True)),
            },
        },
        "grasp_quality": float(facts["quality"]),
        "pre_grasp_approach": translation(-1.0, 0.10),
        "post_grasp_retreat": translation(1.0, facts["lift_height"]),
        "post_place_retreat": translation(1.0, 0.10),
        "max_contact_force": facts["largest_force"],
        "allowed_touch_objects": [facts["object"]],
    }


def _trajectory(base: str, joints: Names, points: list[Fields]) -> Fields:
    return {"header": _header(base), "joint_names": list(joints), "points": points}


def _point(
    seconds: float, positions: list[float], velocities: Sequence[float] = (), effort: Sequence[float] = ()
) -> Fields:
    sec, nanosec = divmod(round(seconds * 1e9), 10**9)
    return {
        "positions": positions,
        "velocities": list(velocities),
        "accelerations": [],
        "effort": list(effort),
        "time_from_start": {"sec": sec, "nanosec": nanosec},
    }


def _header(base: str) -> Fields:
    return {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": base}


def _head(trajectory: Trajectory, facts: Fields) -> Fields:
    return {
        "schema": SCHEMA,
        "frame": trajectory.robot.arm.bodies[0],
        "units": {"time": "s", "angle": "rad", "length": "m", "torque": "Nm", "mass": "kg"},
        "segments": [{"name": name, "start": start, "end": end} for name, start, end in trajectory.segments],
    } | facts


def _table(joints: Names, period: float, rows: Array) -> str:
    lines = [[f"{k * period:.6f}", *(f"{value:.17g}" for value in row)] for k, row in enumerate(rows)]
    return "\n".join(map(",".join, [["t", *joints], *lines]))


def _yaml(content: Fields) -> str:
    import yaml

    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=10**6).rstrip()


def _write(path: Path, text: str) -> Path:
    write_atomically(path, f"{text}\n".encode())
    return path


def write_scene(
    folder: Path, model: ObjectModel, T_world_object: Array, cell: Cell, neighbours: Sequence[Array] = ()
) -> list[Path]:
    """Write `scene.xml` and `meshes/`: robot, table and object, with a keyframe `start`.

    Args:
        folder: made if it is not there.
        model: the object.
        T_world_object: (4, 4) its pose at the start.
        cell: with the mount in use.
        neighbours: corners (V, 3) m of what stands around the object, world frame: geoms `around0` on, fixed there.
    """
    spec = scene_spec(model, cell)
    for k, corners in enumerate(neighbours):
        mesh = spec.add_mesh(name=f"around{k}")
        mesh.uservert, mesh.inertia = corners.ravel(), mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        spec.worldbody.add_geom(name=f"around{k}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"around{k}")
    home, R = cell.robot.home.tolist(), T_world_object[:3, :3]
    spec.add_key(name="start", qpos=[*home, *T_world_object[:3, 3], *matrix_to_quat(R)], ctrl=home)
    with_decimal_points(spec.compile)
    write_atomically(folder / SCENE, _portable(with_decimal_points(spec.to_xml), folder / MESHES).encode())
    return [folder / SCENE, *sorted((folder / MESHES).iterdir())]


def _portable(xml: str, meshes: Path) -> str:
    """Copy every mesh file that the text names to one folder, and name it there."""
    meshes.mkdir(parents=True, exist_ok=True)
    shells = asset_path("robot", "shells")

    def copied(match: "re.Match[str]") -> str:
        """Copy a shell beside the scene, and return how the scene names it."""
        name = Path(match.group(1)).name
        shutil.copyfile(shells / name, meshes / name)
        return f'file="{MESHES}/{name}"'

    return re.sub(r'file="([^"]+)"', copied, re.sub(r'\s(mesh|texture|asset)dir="[^"]*"', "", xml))
