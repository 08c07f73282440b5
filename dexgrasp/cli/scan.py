"""Options of `dexgrasp plan --cloud`: a cloud of your own, and which object in it is the target."""

from dataclasses import replace
from functools import cached_property
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from dexgrasp.cli.command import File, Options
from dexgrasp_env.errors import InputError, first_line
from dexgrasp_env.valid import Mass

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from dexgrasp.planning.result import PlanResult
    from dexgrasp_env.arrays import Array
    from dexgrasp_env.perception.cloud import Cloud
    from dexgrasp_env.perception.detected import DetectedObject
    from dexgrasp_env.perception.scene import Scene
    from dexgrasp_env.perception.selection import TargetSelector
    from dexgrasp_env.robot.cell import Cell


class CloudOptions(Options):
    """Your own scene, instead of TARGET. Everything in it but the object that is meant is an obstacle.

    Attributes:
        cloud: ply, pcd, txt, csv, xyz, pts, asc, npy, npz, las, laz or a ROS bag (BAG#TOPIC), in the robot base frame
            or with --camera-pose; or a folder with cameras.yaml and depth images.
        camera_pose: the camera's optical frame in the robot base frame, where the cloud is in the camera's: a file
            (4 x 4 as txt, npy, yaml or json, or a pose of ROS), or in quotes "x y z qw qx qy qz", m; as ROS
            orders it "x y z qx qy qz qw xyzw".
        unit: of that file's coordinates.
        objects: list the objects that are seen, and plan nothing (with --out, a picture with their numbers).
        object_near: a point near the object that is meant, m.
        box: a box that holds the object that is meant, m.
        mask: npy or png, one bool or whole number for each point of the file, or each pixel of the folder's images.
        label: the object's number in the mask, where it has several.
        pixel: where a camera of the folder sees the object that is meant, column and row.
        mass: of the object, kg, where it is known.
    """

    cloud: File | None = None
    camera_pose: Annotated[str | None, "POSE"] = None
    unit: Literal["m", "cm", "mm"] = "m"
    objects: bool = False
    object_near: Annotated[tuple[float, float, float] | None, "X", "Y", "Z"] = None
    box: Annotated[
        tuple[float, float, float, float, float, float] | None, "X0", "Y0", "Z0", "X1", "Y1", "Z1"
    ] = None
    mask: Annotated[Path | None, "FILE"] = None
    label: Annotated[int | None, "K"] = None
    pixel: Annotated[tuple[str, str, str] | None, "CAMERA", "U", "V"] = None
    mass: Annotated[Mass | None, "KG"] = None

    @property
    def of_cloud(self) -> list[str]:
        """Options that were given and apply to clouds only, as they are typed."""
        return [option for option in self.given(*CloudOptions.__annotations__) if option != "--cloud"]

    @cached_property
    def pose(self) -> "Array | None":
        """Pose (4, 4) of the camera in the frame of the robot's base; None where it is not given."""
        from dexgrasp_env.perception.camera_pose import read_pose

        return None if self.camera_pose is None else read_pose(self.camera_pose)

    def order_line(self) -> str:
        """Return a warning where the other order of the quaternion would leave the table level too; else empty."""
        from dexgrasp_env.perception.camera_pose import misread_poses

        if self.pose is None or self.camera_pose is None:
            return ""
        words, other = next(misread_poses(self.pose, self.camera_pose))
        likely = "xyzw" in words and other[2, :3] @ self.pose[2, :3] > 0.99
        return (
            "warning: --camera-pose is read as x y z qw qx qy qz; ROS's order, w last, would be level too"
            if likely
            else ""
        )

    def frame_words(self, scan: "Cloud", look: "Callable[[Cloud], Scene]") -> "Iterator[str]":
        """Yield possible mistakes of frame, for a cloud in which `look` finds no table where it should be."""
        import numpy as np

        from dexgrasp_env.perception.camera_files import CAMERAS_FILE, read_cameras
        from dexgrasp_env.perception.camera_pose import misread_poses
        from dexgrasp_env.perception.reasons import OF_FRAME

        name, file = "--camera-pose", Path(str(self.cloud)) / CAMERAS_FILE
        poses = [] if self.pose is None else [self.pose]
        if not poses and file.is_file():
            name, poses = "T_base_camera", [image.T_base_camera for image in read_cameras(file)]
        if not poses:
            yield "of a cloud in a camera's frame --camera-pose says where the camera is"
            return
        for readings in zip(*(misread_poses(T, self.camera_pose or "") for T in poses), strict=True):
            points = scan.points.copy()
            for k, (T, (_, other)) in enumerate(zip(poses, readings, strict=True)):
                R, own = other @ np.linalg.inv(T), scan.camera == k
                points[own] = points[own] @ R[:3, :3].T + R[:3, 3]
            if look(scan.moved(points)).reason not in OF_FRAME:
                yield f"it would be right if {name} {readings[0][0]}"

    def selector(self) -> "TargetSelector":
        """Return the selector of the target.

        Raises:
            InputError: for more than one way to point, or one that points at nothing.
        """
        import numpy as np

        from dexgrasp_env.perception.selection import TargetSelector, point_of_pixel, read_mask

        if sum(way is not None for way in (self.object_near, self.box, self.mask, self.pixel)) > 1:
            raise InputError("point in one way: --object-near, --box, --mask or --pixel")
        if self.label is not None and self.mask is None:
            raise InputError("--label is of a --mask")
        near = None if self.object_near is None else np.array(self.object_near)
        if self.pixel is not None:
            camera, u, v = self.pixel
            if not (u.isdecimal() and v.isdecimal()):
                raise InputError(f"--pixel {camera} {u} {v}: valid is a camera's name, a column and a row")
            near = point_of_pixel(Path(str(self.cloud)), camera, int(u), int(v), self.pose)
        box = None if self.box is None else np.reshape(self.box, (2, 3))
        return TargetSelector(near, box, None if self.mask is None else read_mask(self.mask, self.label))


def list_lines(seen: "list[DetectedObject]") -> list[str]:
    """Return a line for each detected object."""
    lines = []
    for one in seen:
        gap = "none" if one.next > 1e3 else f"{100 * one.next:.1f} cm"
        lines.append(f"  {one.number}: {one}, the next {gap} away{'; ' * bool(one.doubt)}{one.doubt}")
    return lines


def table_line(scene: "Scene", cell: "Cell") -> str:
    """Return warnings: a table that is not where the cell has it, and those of the scene."""
    off = "" if scene.table is None else scene.table.differs(cell.table_height)
    return "\n".join(f"warning: {said}" for said in (off, scene.note) if said)


def chosen_line(seen: "list[DetectedObject]") -> str:
    """Return a line on the target and on what stands within 15 cm of it."""
    first, *others = seen
    near = 0.15  # m
    beside = [one for one in others if one.apart < near]
    said = "; ".join(
        f"{one}, {100 * one.apart:.1f} cm away" for one in sorted(beside, key=lambda one: one.apart)
    )
    line = f"object: {first}; within {100 * near:.0f} cm: {said or 'nothing'}"
    return (
        f"doubt: the object {first.doubt} (a --mask tells one object from another)\n" * bool(first.doubt)
        + line
    )


def blocking_lines(scene: "Scene", seen: "list[DetectedObject]", found: "PlanResult") -> list[str]:
    """Return a line for each object that blocks every lift; where none does, for each that may be too near."""
    from dexgrasp.geometry.neighbours import neighbours_of, without_splinters
    from dexgrasp.grasp.grasp import RAISED
    from dexgrasp.motion.collision import raised_into
    from dexgrasp_env.perception.scene import ObjectCloud

    if found.target is None or found.found:
        return []
    around = [
        (f"object {own.number} ({own})", replace(scene, neighbours=(cloud,), rest=ObjectCloud()), own.apart)
        for own, cloud in zip(seen[1:], scene.neighbours, strict=True)
    ]
    over, beside = list[str](), list[str]()
    for words, alone, apart in (
        *around,
        ("what is no object", replace(without_splinters(scene), neighbours=()), inf),
    ):
        if raised_into(replace(found.target, neighbours=neighbours_of(alone)), RAISED) > 0.0:
            over.append(f"in the way of lifting it straight up: {words}: take that away first")
        elif apart < 0.04:  # m beside the object that fingers need
            beside.append(f"perhaps too near for the hand: {words}, {100 * apart:.1f} cm away")
    return over or beside


def draw_scan(
    path: Path,
    scan: "Cloud",
    scene: "Scene",
    seen: "list[DetectedObject]",
    found: "PlanResult | None",
    cell: "Cell",
) -> str:
    """Draw the perceived scene and the planned grasp; return a line that names the picture, or why there is none.

    A fault of drawing never stops a plan.
    """
    try:
        from dexgrasp.grasp.picture import hand_triangles
        from dexgrasp_env.perception.picture import Drawing, scene_picture
        from dexgrasp_env.poses import placed

        target = None if found is None else found.target
        grasp = None if found is None else found.grasp
        clouds = [one.points for one in (scene.target, *scene.neighbours) if len(one)]
        rest = scene.rest.points
        if not clouds:  # all that there is
            rest = placed(cell.T_world_base, scan.points[:: max(1, len(scan) // 20_000)])
        scene_picture(
            path,
            Drawing(
                dict(zip(list_lines(seen), clouds, strict=True)),
                rest,
                scene.plane,
                None if target is None else target.distance.triangles,
                {} if grasp is None else {"hand, where it grasps": hand_triangles(grasp.cell, grasp.q)},
                scene.sentence or (found and found.reason) or ("a grasp" if grasp else ""),
            ),
        )
    except Exception as error:
        return f"note: no picture {path} ({first_line(error)})"
    return f"wrote {path}"
