"""The poses an object comes to rest in on a table, found by dropping it on a plane until it lies still."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dexgrasp_env.arrays import Array, fibonacci_directions
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import cache_dir, write_json
from dexgrasp_env.objects.mjcf import add_to_spec
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.parts import support_height
from dexgrasp_env.poses import frame_of_z, matrix_to_quat, quat_to_matrix

if TYPE_CHECKING:
    import mujoco


_TIMESTEP = 0.002
MERGE_ANGLE = np.deg2rad(16.0)
MOST_POSES = 12
_SCHEMA = 2


def stays(model: ObjectModel, up: Array) -> bool:
    """Return True where the object, put down with the vertical `up` (3,), rests within 16 degrees of it."""
    end = _drop_one(drop_model(model), model, up, 2e-4)
    return end is not None and bool((end[0] * up).sum() >= np.cos(MERGE_ANGLE))


def drop_model(model: ObjectModel) -> mujoco.MjModel:
    """Return the object alone over a plane, with a little rolling friction so that round things stop."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.timestep = _TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    friction = [0.7, 0.005, 2e-4]  # sliding, torsional m, rolling m
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 1], friction=friction)
    body = spec.worldbody.add_body(name="object")
    body.add_freejoint(name="object")
    add_to_spec(spec, body, model, visual=False, condim=6)
    for geom in body.geoms:
        geom.friction = friction
    mj_model = spec.compile()
    mj_model.dof_damping[3:6] = np.trace(model.inertia) / 3 / 0.3  # a spin ends in 0.3 s
    return mj_model


def _drop_one(
    mj_model: mujoco.MjModel, model: ObjectModel, up: Array, gap: float
) -> tuple[Array, float] | None:
    """Return the vertical in the object frame at rest and the speed left, m/s at the rim, or None if it never rests.

    `up` (3,) is the world's vertical in the object frame at the start.
    """
    import mujoco

    data = mujoco.MjData(mj_model)
    data.qpos[2] = support_height(model.parts, up) + gap
    data.qpos[3:7] = matrix_to_quat(frame_of_z(up).T)  # turns `up` to the world's vertical
    radius = 0.5 * float(model.extents.max())
    still = 0
    for _ in range(int(6.0 / (_TIMESTEP * 25))):  # s
        mujoco.mj_step(mj_model, data, 25)
        speed = float(np.linalg.norm(data.qvel[:3]) + radius * np.linalg.norm(data.qvel[3:]))
        still = still + 1 if speed < 2e-3 and data.ncon > 0 else 0  # m/s
        if still == 4:
            vertical = data.xmat[1].reshape(3, 3)[2]
            return vertical / np.linalg.norm(vertical), speed
    return None


@dataclass(frozen=True)
class RestPose:
    """One way of lying on the table; any turn about the vertical is the same pose.

    Attributes:
        quat_wxyz: (4,) orientation in the world.
        height: metres of the object's origin above the table when its lowest point touches it.
        probability: share of the drops that ended in it.
    """

    quat_wxyz: tuple[float, float, float, float]
    height: float
    probability: float

    @property
    def up(self) -> Array:
        """(3,) the world's vertical in the object frame."""
        return quat_to_matrix(np.array(self.quat_wxyz))[2]


@lru_cache(maxsize=64)
def rest_poses(model: ObjectModel) -> tuple[RestPose, ...]:
    """Return the rest poses, likeliest first: shipped ones, cached ones, or dropped for now and cached."""
    cached = cache_dir() / "rest_poses" / f"{model.contact_hash}.json"
    for path in (asset_path("rest_poses") / f"{model.name}.json", cached):
        if poses := read_poses(path, model.contact_hash):
            return poses
    poses = find_rest_poses(model)
    with suppress(OSError):
        write_poses(cached, model, poses)
    return poses


def find_rest_poses(model: ObjectModel) -> tuple[RestPose, ...]:
    """Drop the object from 240 even orientations and gather where it ends; always the same for the same
    object.

    Drops are merged when the vertical in the object frame differs by at most 16 degrees, directly or through
    others in between, so that a continuum of rolling poses counts once. For a body of revolution only the
    angle to its axis counts. Each group is represented by its calmest drop, turned flat onto the facet it
    rests on, and kept only if it stays there when simulated again. At most `MOST_POSES` are kept.

    Raises:
        InputError: if it comes to rest nowhere.
    """
    from trimesh.convex import convex_hull

    mj_model = drop_model(model)
    settled = [end for up in fibonacci_directions(240) if (end := _drop_one(mj_model, model, up, 0.005))]
    ups, calm = np.reshape([up for up, _ in settled], (-1, 3)), np.array([speed for _, speed in settled])
    surfaces = [part.surface().vertices for part in model.parts]
    normals = np.array(convex_hull(np.concatenate(surfaces)).face_normals)  # (n, 3), outward
    poses: list[RestPose] = []
    for group in sorted(clusters(merge_keys(model, ups)), key=len, reverse=True):
        up = _flat(normals, ups[group[int(np.argmin(calm[group]))]])
        if len(poses) < MOST_POSES and stays(model, up):
            poses.append(RestPose(_upright(up), support_height(model.parts, up), len(group) / len(ups)))
    if not poses:
        raise InputError(f"{model.name} comes to rest in no pose: check its contact parts and its mass")
    total = sum(pose.probability for pose in poses)
    return tuple(RestPose(p.quat_wxyz, round(p.height, 7), round(p.probability / total, 6)) for p in poses)


def merge_keys(model: ObjectModel, ups: Array) -> Array:
    """Return (n, 3) directions to merge by: `ups` (n, 3), turned into one plane for a body of revolution."""
    axis = symmetry_axis(model)
    if axis is None:
        return ups
    along = (ups * axis).sum(-1)
    return np.stack([along, np.sqrt(np.maximum(1.0 - along**2, 0.0)), np.zeros_like(along)], axis=-1)


def symmetry_axis(model: ObjectModel) -> Array | None:
    """Return the axis (3,) about which the object's hull is round within about 1 % of its size, or None."""
    values, vectors = np.linalg.eigh(model.inertia)
    odd = 2 if values[1] - values[0] < values[2] - values[1] else 0
    if np.ptp(np.delete(values, odd)) > 0.02 * values[2] or np.ptp(values) < 0.02 * values[2]:
        return None
    axis, side = vectors[:, odd], vectors[:, (odd + 1) % 3]
    turn = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)[:, None]
    ring = np.cos(turn) * side + np.sin(turn) * np.cross(axis, side)
    around = (np.cos(tilt) * ring + np.sin(tilt) * axis for tilt in np.linspace(-1.2, 1.2, 7))
    reach = max(np.ptp((ways @ np.asarray(model.hull.vertices).T).max(-1)) for ways in around)
    return axis if reach < 0.012 * model.extents.max() else None


def clusters(directions: Array) -> list[np.ndarray]:
    """Group unit vectors (n, 3) that are within 16 degrees of each other, directly or through others."""
    from scipy.sparse.csgraph import connected_components

    near = directions @ directions.T >= np.cos(MERGE_ANGLE)
    count, label = connected_components(near, directed=False)
    return [np.flatnonzero(label == index) for index in range(count)]


def read_poses(path: Path, contact_hash: str) -> tuple[RestPose, ...] | None:
    """Return the poses of a file, or None if it is missing, damaged, or made for another shape or mass."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["schema"] != _SCHEMA or data["contact_hash"] != contact_hash:
            return None
        return tuple(RestPose(tuple(p["quat_wxyz"]), p["height"], p["probability"]) for p in data["poses"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def write_poses(path: Path, model: ObjectModel, poses: Sequence[RestPose]) -> None:
    """Write the poses of `model` with the hash they were made for."""
    write_json(
        path,
        {
            "schema": _SCHEMA,
            "name": model.name,
            "contact_hash": model.contact_hash,
            "poses": [*map(asdict, poses)],
        },
    )


def _flat(normals: Array, up: Array) -> Array:
    """Turn the vertical `up` (3,) onto the one of the facets' `normals` (n, 3) that it nearly rests on."""
    cosine = -(normals * up).sum(-1)
    best = int(np.argmax(cosine))
    return -normals[best] / np.linalg.norm(normals[best]) if cosine[best] > np.cos(np.deg2rad(4.0)) else up


def _upright(up: Array) -> tuple[float, float, float, float]:
    """Quaternion wxyz of the least rotation that turns `up` (3,) of the object to the world's vertical."""
    if up[2] < -1 + 1e-9:
        return (0.0, 1.0, 0.0, 0.0)
    quat = np.array([1.0 + up[2], *np.cross(up, [0.0, 0.0, 1.0])])
    w, x, y, z = (round(float(value), 9) + 0.0 for value in quat / np.linalg.norm(quat))
    return (w, x, y, z)
