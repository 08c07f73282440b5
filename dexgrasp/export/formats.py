"""Trajectories as files: CSV, JSON, and ROS 2 messages as YAML, written without ROS."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.export.trajectory import ARM_TICK, HAND_EVERY, Trajectory
from dexgrasp_env.arrays import Array
from dexgrasp_env.files import write_atomically
from dexgrasp_env.robot.names import ARM_JOINTS, HAND_JOINTS

SCHEMA = 1
_ROS_EVERY = 10  # rows of the arm to a point of a ROS trajectory: its controllers interpolate


def write_csv(folder: Path, trajectory: Trajectory, facts: dict[str, Any]) -> list[Path]:
    """Write `arm.csv` (1 kHz), `hand.csv` (333 Hz), s and rad with 17 digits, and `segments.json` with the rest."""
    hand_tick = ARM_TICK * HAND_EVERY
    return [
        _write(folder / "arm.csv", _table(trajectory.arm, ARM_JOINTS, ARM_TICK)),
        _write(folder / "hand.csv", _table(trajectory.hand, HAND_JOINTS, hand_tick)),
        _write(folder / "segments.json", json.dumps(_head(trajectory, facts), indent=1) + "\n"),
    ]


def write_json(folder: Path, trajectory: Trajectory, facts: dict[str, Any]) -> list[Path]:
    """Write `trajectory.json`: names, units, segments, the squeeze, and the rows of arm and hand."""
    content = _head(trajectory, facts) | {
        "arm": {"joints": list(ARM_JOINTS), "period": ARM_TICK, "positions": trajectory.arm.tolist()},
        "hand": {
            "joints": list(HAND_JOINTS), "period": ARM_TICK * HAND_EVERY, "positions": trajectory.hand.tolist(),
        },
    }  # fmt: skip
    return [_write(folder / "trajectory.json", json.dumps(content) + "\n")]


def write_ros2(folder: Path, trajectory: Trajectory, facts: dict[str, Any]) -> list[Path]:
    """Write `arm.yaml` and `hand.yaml` (trajectory_msgs/JointTrajectory) and `grasp.yaml` (moveit_msgs/Grasp)."""
    arm, hand = trajectory.arm[::_ROS_EVERY], trajectory.hand[:: _ROS_EVERY // 2]
    periods = ARM_TICK * _ROS_EVERY, ARM_TICK * HAND_EVERY * (_ROS_EVERY // 2)
    return [
        _write(folder / "arm.yaml", _yaml(joint_trajectory(ARM_JOINTS, arm, periods[0]))),
        _write(folder / "hand.yaml", _yaml(joint_trajectory(HAND_JOINTS, hand, periods[1]))),
        _write(folder / "grasp.yaml", _yaml(moveit_grasp(facts))),
    ]


def joint_trajectory(names: tuple[str, ...], rows: Array, period: float) -> dict[str, Any]:
    """Return a trajectory_msgs/JointTrajectory: positions (T, n) rad with velocities by central differences."""
    velocities = np.gradient(rows, period, axis=0) if len(rows) > 1 else np.zeros_like(rows)
    velocities[0] = velocities[-1] = 0.0
    points = [
        {"positions": q.tolist(), "velocities": v.tolist(), "accelerations": [], "effort": [],
         "time_from_start": _duration(k * period)}
        for k, (q, v) in enumerate(zip(rows, velocities, strict=True))
    ]  # fmt: skip
    return {"header": _header(), "joint_names": list(names), "points": points}


def moveit_grasp(facts: dict[str, Any]) -> dict[str, Any]:
    """Return a moveit_msgs/Grasp; `grasp_pose` is of the palm frame in the robot base frame."""
    posture = {key: facts[key] for key in ("open", "closed")}
    palm = facts["palm"]
    return {
        "id": str(facts["object"]),
        "pre_grasp_posture": _posture(posture["open"], None),
        "grasp_posture": _posture(posture["closed"], facts["squeeze"]["torque"]),
        "grasp_pose": {
            "header": _header(),
            "pose": {
                "position": dict(zip("xyz", palm["position"], strict=True)),
                "orientation": dict(zip("wxyz", palm["quat_wxyz"], strict=True)),
            },
        },
        "grasp_quality": float(facts["quality"]),
        "pre_grasp_approach": _translation((0.0, 0.0, -1.0), 0.10),
        "post_grasp_retreat": _translation((0.0, 0.0, 1.0), float(facts["lift_height"])),
        "post_place_retreat": _translation((0.0, 0.0, 1.0), 0.10),
        "max_contact_force": float(facts["largest_force"]),
        "allowed_touch_objects": [str(facts["object"])],
    }


def _posture(hand: list[float], torque: list[float] | None) -> dict[str, Any]:
    point = {
        "positions": list(hand), "velocities": [], "accelerations": [], "effort": list(torque or []),
        "time_from_start": _duration(0.0),
    }  # fmt: skip
    return {"header": _header(), "joint_names": list(HAND_JOINTS), "points": [point]}


def _translation(direction: tuple[float, float, float], distance: float) -> dict[str, Any]:
    vector = dict(zip("xyz", direction, strict=True))
    return {
        "direction": {"header": _header(), "vector": vector},
        "desired_distance": distance,
        "min_distance": 0.5 * distance,
    }


def _header() -> dict[str, Any]:
    return {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "panda_link0"}


def _duration(seconds: float) -> dict[str, int]:
    nanoseconds = round(seconds * 1e9)
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


def _head(trajectory: Trajectory, facts: dict[str, Any]) -> dict[str, Any]:
    segments = [{"name": name, "start": start, "end": end} for name, start, end in trajectory.segments]
    return {
        "schema": SCHEMA, "frame": "panda_link0",
        "units": {"time": "s", "angle": "rad", "length": "m", "torque": "Nm", "mass": "kg"},
        "segments": segments,
    } | facts  # fmt: skip


def _table(rows: Array, names: tuple[str, ...], tick: float) -> str:
    lines = [",".join(("t", *names))]
    for k, row in enumerate(rows):
        lines.append(",".join([f"{k * tick:.6f}", *(f"{value:.17g}" for value in row)]))
    return "\n".join(lines) + "\n"


def _yaml(content: dict[str, Any]) -> str:
    import yaml

    return str(yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=10**6))


def _write(path: Path, text: str) -> Path:
    write_atomically(path, text.encode())
    return path
