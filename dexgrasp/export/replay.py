"""An exported trajectory carried out in MuJoCo, open loop, with the object a little off where it was planned."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.export.read import Recording
from dexgrasp.geometry.hull import axes_of_symmetry
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import check_file
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.poses import placed, pose_matrix
from dexgrasp_env.robot.cell import Cell, default_cell
from dexgrasp_env.scene.geom_mesh import geom_mesh

HOLD = 3.0
"""s that the object must stay up after the lift."""
HEIGHT = 0.10
"""m that it must stay up."""
BESIDE, ASKEW = 0.02, np.radians(10.0)
"""m and rad that an object that is set down may stand off its goal."""


@dataclass(frozen=True)
class Replay:
    """Result of a replay.

    Attributes:
        success: held 10 cm up for 3 s; of an object that is set down, it stands at its goal 3 s later, and nothing
            that stands around it was touched.
        height: m, the least meanwhile above where it lay.
        off, turned: m and rad from its goal; where any heading will do, by how much it leans, and of a body of
            revolution the least over turns about its axis, which nobody can see.
        touched: whether robot or object met what stands around.
    """

    success: bool
    height: float
    off: float = 0.0
    turned: float = 0.0
    touched: bool = False


def replay(
    recording: Recording, scene: Path, rng: np.random.Generator | None = None, cell: Cell | None = None
) -> Replay:
    """Play a trajectory in the scene of `export --format mjcf`.

    Args:
        recording: as read.
        scene: its `scene.xml`; the object starts at the keyframe `start`.
        rng: draws the object's error; None leaves the object where it is.
        cell: of the trajectory; the simulated one by default.

    Raises:
        InputError: if the scene does not load or has no free body `object`.
    """
    import mujoco

    cell = cell or default_cell()
    model, data = load_scene(scene, recording)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    free = model.joint("object").qposadr[0]
    if rng is not None:
        displace(data.qpos[free : free + 7], rng)
    data.qpos[: model.nu] = data.ctrl[:] = set_points(recording, 0.0)
    body = model.body("object").id
    mujoco.mj_forward(model, data)
    start, least = float(data.xpos[body, 2]), np.inf
    end, touched = recording.arm.times[-1], False
    goal = _goal(recording, model, cell)
    around = [k for k in range(model.ngeom) if model.geom(k).name.startswith("around")]
    while data.time < end + HOLD:
        data.ctrl[:] = set_points(recording, data.time)
        mujoco.mj_step(model, data)
        touched |= bool(np.isin(data.contact.geom, around).any())
        if data.time >= end:
            least = min(least, float(data.xpos[body, 2]) - start)
    if goal is None:
        return Replay(least >= HEIGHT, least, touched=touched)
    off = float(np.linalg.norm(data.xpos[body] - goal[:3, 3]))
    axes = axes_of_symmetry(_corners(model, body))
    turned = turned_by(data.xmat[body].reshape(3, 3), goal[:3, :3], axes, recording.facts.any_heading)
    return Replay(off <= BESIDE and turned <= ASKEW and not touched, least, off, turned, touched)


def turned_by(now: Array, goal: Array, axes: Array, any_heading: bool) -> float:
    """Return by how much, rad, a body is turned from its goal, rotations (3, 3); turns that do not show do not count.

    Args:
        now: of the body.
        goal: where it was to be.
        axes: (K, 3) of symmetry, body frame, see `axes_of_symmetry`.
        any_heading: turns about the vertical do not count either.
    """
    if len(axes) > 1:
        return 0.0
    if not len(axes) and not any_heading:
        return float(Rotation.from_matrix(now @ goal.T).magnitude())
    # The way of an axis, or of what is to be vertical, is all that shows.
    here, there = (R @ (axes[0] if len(axes) else goal[2]) for R in (now, goal))
    if len(axes) and any_heading:
        return float(np.ptp(np.arccos(np.clip([here[2], there[2]], -1.0, 1.0))))
    return float(np.arccos(np.clip(here @ there, -1.0, 1.0)))


def _corners(model: Any, body: int) -> Array:
    """Return the corners (N, 3) m of all geoms of a body, its frame."""
    own = np.flatnonzero(model.geom_bodyid == body).tolist()
    poses = [pose_matrix(model.geom_pos[k], model.geom_quat[k]) for k in own]
    return np.concatenate([placed(T, geom_mesh(model, k).vertices) for T, k in zip(poses, own, strict=True)])


def _goal(recording: Recording, model: Any, cell: Cell) -> Array | None:
    """Return the pose (4, 4) at which the object is to stand in the end; None where it is held."""
    if recording.facts.placed is None:
        return None
    free = model.joint("object").qposadr[0]
    pose = model.key_qpos[0, free : free + 7]
    there = cell.seeing(recording.facts.table)
    return there.T_world_base @ recording.facts.placed @ there.T_base_world @ pose_matrix(pose[:3], pose[3:])


def load_scene(scene: Path, recording: Recording) -> tuple[Any, Any]:
    """Return MuJoCo's model and data of a `scene.xml` for a trajectory.

    Raises:
        InputError: if it does not load, or is no scene of a trajectory.
    """
    import mujoco

    if not scene.is_file():
        raise InputError(f"{scene} is not there: a replay needs the scene of `dexgrasp export --format mjcf`")
    check_file(scene)
    try:
        model = with_decimal_points(mujoco.MjModel.from_xml_path, str(scene))
        model.joint("object")
    except (ValueError, KeyError) as error:
        raise InputError(f"{scene} is no scene of a trajectory: {' '.join(str(error).split())}") from None
    joints = len(set_points(recording, 0.0))
    if model.nkey < 1 or model.nu != joints:
        raise InputError(f"{scene} is no scene of a trajectory: {joints} actuators and a keyframe are needed")
    return model, mujoco.MjData(model)


def set_points(recording: Recording, time: float) -> Array:
    """Return the set-points (n,) rad that the controllers hold at a time, s: each its last row."""
    return np.concatenate(
        [
            part.positions[np.searchsorted(part.times, time + 1e-9, side="right") - 1]
            for part in (recording.arm, recording.hand)
        ]
    )


def displace(pose: Array, rng: np.random.Generator) -> None:
    """Move a free joint's pose (7,), in place, by the error that is stated."""
    direction, axis = rng.normal(size=(2, 3))
    pose[:3] += 0.003 * direction / np.linalg.norm(direction)
    turn = Rotation.from_rotvec(np.radians(1.0) * axis / np.linalg.norm(axis))
    pose[3:] = (turn * Rotation.from_quat(pose[3:], scalar_first=True)).as_quat(scalar_first=True)
