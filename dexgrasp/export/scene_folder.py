"""The whole scene as a folder of MJCF and meshes that loads by itself anywhere."""

import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import mujoco

from dexgrasp_env.arrays import Array
from dexgrasp_env.assets import asset_path
from dexgrasp_env.files import write_atomically
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.poses import matrix_to_quat
from dexgrasp_env.robot.cell import Cell

SCENE, MESHES = "scene.xml", "meshes"


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
    from dexgrasp_env.scene.build import scene_spec

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
