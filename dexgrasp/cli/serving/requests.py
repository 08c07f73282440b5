"""Requests of clients: options of `dexgrasp plan` and `verify` by name, with arrays in place of files."""

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from dexgrasp.cli.plan import Plan, check_target
from dexgrasp_env.arrays import Fields, Mask, numbers
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.files import jsonable
from dexgrasp_env.perception.camera_pose import pose_of
from dexgrasp_env.perception.cloud import Cloud, check_count, gather, remove_flying
from dexgrasp_env.perception.scan import UNITS, cloud_of, posed
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.perception.selection import TargetSelector, mask_of
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics
from dexgrasp_env.valid import Rule, read, several

_NOT_OFFERED = (
    "robot",
    "mount",
    "json",
    "out",
    "agent",
    "cloud",
    "camera_pose",
    "pixel",
    "objects",
    "mask",
    "floating",
)
"""Options of `plan` that clients cannot set: they are the server's, name files, or are sent as arrays."""


_REGIONS = several(Rule("a text or a mask", lambda said: said if isinstance(said, str) else np.asarray(said)))


class _PlanRequest(Plan):
    """Request of a plan: the options of the command, with arrays in place of its files.

    Attributes:
        name: of the object, in the answer.
        points: (N, 3) in `unit`, in the frame of the robot's base, or of the camera whose pose `T_base_camera` says.
        depth: (H, W) m, instead of points; 0 and what is not finite is no measurement.
        K: (3, 3) the intrinsics of its camera, pixels.
        T_base_camera: (4, 4) pose of its optical frame in the frame of the robot's base, m.
        marked: one bool or whole number for each point or pixel: where the object is seen.
        hold, avoid: as the command's, but a mask is an array: one bool for each point or pixel, or each face.
        vertices: (V, 3) of a mesh as the target, in `mesh_scale` m, z up.
        faces: (F, 3) rows of it, from outside anticlockwise.
    """

    name: str = ""
    points: Any = None
    depth: Annotated[Any, numbers("an array (H, W) of numbers", None, None)] = None
    K: Annotated[Any, numbers("3 x 3 numbers", 3, 3)] = None
    T_base_camera: Annotated[Any, Rule("a pose: 4 x 4 numbers, or x y z qw qx qy qz", pose_of)] = None
    marked: Any = None
    vertices: Annotated[Any, numbers("an array (V, 3) of numbers", None, 3)] = None
    faces: Annotated[Any, numbers("an array (F, 3) of whole numbers", None, 3)] = None
    hold: Annotated[tuple[Any, ...], _REGIONS] = ()
    avoid: Annotated[tuple[Any, ...], _REGIONS] = ()

    def scan(self) -> Cloud:
        """Return the cloud that was sent."""
        T, of_camera = self.T_base_camera, self.depth is not None
        given = self.points is None, self.K is not None, of_camera and T is not None
        if given != (of_camera,) * 3:
            raise InputError("send points, or depth with K and T_base_camera")
        if not of_camera:
            cloud = cloud_of(self.points)
            cloud = cloud.moved(cloud.points * UNITS[self.unit])
            return cloud if T is None else posed(cloud, T)
        check_count(self.depth.size, "depth")
        (height, width), K = self.depth.shape, np.asarray(self.K, dtype=float)
        lens = CameraIntrinsics(width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        depth = np.asarray(self.depth, dtype=np.float32)[None]
        return gather(remove_flying(depth), (Camera("camera", T, lens),))

    def frame_words(self, scan: Cloud, look: Callable[[Cloud], Scene]) -> Iterator[str]:
        """Yield possible mistakes of frame."""
        yield "of a cloud in a camera's frame T_base_camera says where the camera is"

    def _mask(self, name: str, said: Any) -> Mask | None:
        if isinstance(said, str) and said.startswith("mask:"):
            raise InputError(f"{name}: valid are box:..., sphere:... and masks as arrays, no files")
        return None if isinstance(said, str) else mask_of(said)

    def say(self, line: str) -> None:
        """Print nothing: it is in the answer, and a pipe that nobody reads would fill."""

    def selector(self) -> TargetSelector:
        """Return the selector of the target."""
        if self.marked is None:
            return super().selector()
        if self.object_near or self.box:
            raise InputError("point in one way: object_near, box or marked")
        return TargetSelector(mask=mask_of(self.marked, self.label))


def answer(message: Fields, robot: str | None, waited: float = 0.0) -> Fields:
    """Return the answer to a request: the JSON that the command prints, and `timing_ms` by stage.

    Args:
        message: `request`, one of `REQUESTS`, and its options.
        robot: cell or robot of the server.
        waited: s, for a worker.

    Raises:
        InputError: for a request or options that are not valid.
    """
    options, began = dict(message), time.perf_counter()
    name = options.pop("request", None)
    if not isinstance(name, str) or name not in REQUESTS:
        raise unknown_name("request", name, REQUESTS)
    content = jsonable({"schema": 1, **REQUESTS[name](options, robot)})
    seen, planned = content.get("stages", {}).get("perception", 0.0), content.get("planning_seconds") or 0.0
    encoding = time.perf_counter() - began - seen - planned
    stages = {"queue": waited, "perception": seen, "planning": planned, "encoding": encoding}
    return content | {"timing_ms": {stage: round(1e3 * seconds, 3) for stage, seconds in stages.items()}}


def _sent(options: Fields, robot: str | None) -> _PlanRequest:
    for key in options:
        if key not in _OPTIONS:
            raise unknown_name("option", key, _OPTIONS)
    lists = {key: tuple(value) if isinstance(value, list) else value for key, value in options.items()}
    return read(_PlanRequest, {**lists, "robot": robot})


_OPTIONS = [name for name in _PlanRequest.__dataclass_fields__ if name not in _NOT_OFFERED]


def _plan(options: Fields, robot: str | None) -> Fields:
    sent = _sent(options, robot)
    if sent.points is not None or sent.depth is not None:
        raise InputError("plan is of a target or a mesh: a cloud is of plan_cloud")
    if sent.vertices is None:
        from dexgrasp_env.objects.load import is_ours

        if sent.target is None or not is_ours(sent.target):
            raise InputError(f"no object {sent.target!r} here: send a mesh as vertices and faces")
        return _planned(sent)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{Path(sent.name).name or 'mesh'}.ply"
        _write_mesh(path, sent)
        return _planned(replace(sent, target=str(path)))


def _planned(sent: _PlanRequest) -> Fields:
    check_target(str(sent.target), sent.agent, sent)
    if sent.of_cloud:
        raise InputError(f"{sent.of_cloud[0]} is of plan_cloud")
    return sent._plan(None)[1]


def _write_mesh(path: Path, sent: _PlanRequest) -> None:
    import trimesh

    vertices, faces = np.asarray(sent.vertices, dtype=float), np.asarray(sent.faces)
    if sent.faces is None or faces.dtype.kind not in "iu" or not len(faces):
        raise InputError("faces are an array (F, 3) of whole numbers")
    most = 200_000  # of a mesh that is sent
    if len(vertices) > most or len(faces) > 2 * most:
        raise InputError(f"a mesh of {len(vertices)} corners is too large: at most {most}")
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError("a mesh has corners that are not finite, or faces of corners that it lacks")
    trimesh.Trimesh(vertices, faces, process=False).export(path)


def _plan_cloud(options: Fields, robot: str | None) -> Fields:
    sent = _on_cloud(options, robot)
    return sent._plan_scan(sent.scan(), None)[1]


def _objects(options: Fields, robot: str | None) -> Fields:
    sent = _on_cloud(options, robot)
    return {"objects": sent._look(sent.scan())[1]}


def _on_cloud(options: Fields, robot: str | None) -> _PlanRequest:
    sent = _sent(options, robot)
    if sent.target is not None or sent.vertices is not None:
        raise InputError("a target or a mesh is of the request plan, not of a cloud's")
    if (sent.mesh_mass, sent.mesh_scale) != (None, 1.0):
        raise InputError("mesh_mass and mesh_scale are of a mesh: the mass of what is seen is mass")
    return replace(sent, cloud=Path(sent.name or "cloud"))


def _verify(options: Fields, robot: str | None) -> Fields:
    from dexgrasp.grasp.file import record_of
    from dexgrasp.grasp.verify.verify import verify
    from dexgrasp_env.robot.cell import make_cell

    if set(options) != {"grasp"} or not isinstance(options["grasp"], dict):
        raise InputError("verify takes `grasp`, the mapping of a grasp file, and nothing else")
    checks = verify(record_of(options["grasp"], "grasp", make_cell(robot)))
    return {"holds": all(check.holds for check in checks), "checks": checks}


REQUESTS: dict[str, Callable[[Fields, str | None], Fields]] = {
    "plan": _plan,
    "plan_cloud": _plan_cloud,
    "objects": _objects,
    "verify": _verify,
}
"""Request -> function that answers it."""
