"""FRoGGeR-style arrays (`.npz`): one configuration of arm and hand by joint names, body poses, contacts, object pose.

Keys: `q` (n,) rad with `joint_names`; `body_names` with `body_poses_W` (b, 4, 4), of which the palm's counts, since arm
and mount are not ours; `X_WO` (4, 4), the mesh file's frame; `contacts_W`, `normals_in_W` (k, 3), normals into the
object; `object`, a name. World: the arm's base, z up, the table's top at z = 0. Pregrasp and squeeze are made by
`closing`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dexgrasp.evaluation.scoring.hand import ALLEGRO, FloatingGrasp
from dexgrasp.evaluation.scoring.readers.fields import FileFields, as_pose
from dexgrasp.evaluation.scoring.readers.json_files import read_plain
from dexgrasp.evaluation.scoring.readers.objects import ReadOptions
from dexgrasp_env.arrays import Arrays
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_npz, readable
from dexgrasp_env.poses import rigid
from dexgrasp_env.yaml_file import read_yaml

PALM = "algr_rh_palm"
JOINTS: dict[str, str] = read_yaml(Path(__file__).with_name("frogger.yaml"))
"""FRoGGeR's joint names -> ours; angles, axes and zeros are the same."""


def read_frogger(path: Path, options: ReadOptions) -> list[FloatingGrasp]:
    """Return the grasp of a file, converted to the plain JSON layout.

    Raises:
        InputError: if the file is unusable, misses a key, or its object is not found.
    """
    data = FileFields(_read_npz(path), str(path))
    names, q = data.words("joint_names"), data.numbers("q")
    joints = {JOINTS[name]: float(value) for name, value in zip(names, q, strict=False) if name in JOINTS}
    if len(names) != len(q) or len(joints) != len(JOINTS):
        raise InputError(
            f"{path}: q and joint_names must name the 16 joints of the hand, {min(JOINTS)} and the like"
        )
    bodies, poses = data.words("body_names"), data.numbers("body_poses_W")
    if PALM not in bodies or len(bodies) != len(poses):
        raise InputError(f"{path}: body_names with body_poses_W must have {PALM}")
    # Its palm frame is at the bottom of the palm, ours at the finger bases; axes are the same.
    to_ours = rigid(np.eye(3), (0.0, 0.0, 0.095))
    T_palm = as_pose(poses[bodies.index(PALM)], f"{path}: pose of {PALM}") @ to_ours
    grasp = {
        "object": data.get("object"), "T_world_object": data.get("X_WO"),
        "grasp": {"T_world_hand": T_palm, "joints": list(joints.values())},
        "contacts": data.get("contacts_W"), "normals_in": data.get("normals_in_W"),
    }  # fmt: skip
    found = read_plain({"joint_names": list(joints), "grasps": [grasp]}, path, replace(options, hand=ALLEGRO))
    return [replace(one, source=str(path)) for one in found]


def _read_npz(path: Path) -> Arrays:
    """Return the arrays of an .npz file; pickled ones are not read.

    Raises:
        InputError: if it is missing, damaged or holds pickled objects.
    """
    with readable(path):
        try:
            return read_npz(path)
        except ValueError as error:
            raise InputError(f"{path} is no .npz file of plain arrays ({error})") from None
