"""Files of DexGraspBench and BODex: `.npy` dictionaries of configurations, object pose and scale.

Three layouts: `pregrasp_qpos`, `grasp_qpos`, `squeeze_qpos` (7 + n: base position m, quaternion wxyz, joints), one or
many along a first axis; the same with the base apart as `*_pose`; and BODex's own `robot_pose` (..., N, stages, 7 + n).
Joints are in the order of the hand's file; for the Allegro: index, middle, ring, thumb, palm to tip, as in ours.
`obj_pose` is of the mesh file's frame, z up, the table at z = 0; `obj_path` an object folder. An `approach_qpos` is not
used.
"""

import io
import pickle
from pathlib import Path

import numpy as np

from dexgrasp.evaluation.scoring.hand import ALLEGRO, FloatingGrasp, HandModel, HandStage, find_hand
from dexgrasp.evaluation.scoring.readers.fields import FileFields, as_pose
from dexgrasp.evaluation.scoring.readers.objects import ReadOptions, named_object, pose_of_centre
from dexgrasp.runs.pickles import unpickle
from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_file, readable
from dexgrasp_env.poses import pose_matrix

_ROOT_TO_PALM = pose_matrix(np.zeros(3), np.array([0.0, 0.5**0.5, 0.0, 0.5**0.5]))
"""Pose of the palm in the root frame of its Allegro file; in BODex's own layout poses are of the palm already."""


def read_dexgraspbench(path: Path, options: ReadOptions) -> list[FloatingGrasp]:
    """Return the grasps of a file.

    Raises:
        InputError: if the file is unusable, asks for code, misses a key, or its object is not found.
    """
    data, hand = FileFields(read_dictionary(path), str(path)), find_hand(options.hand)
    rows, to_hand = _configurations(data, hand)
    scale = data.numbers("obj_scale").item(0) if "obj_scale" in data else 1.0
    named = (data.get(key) for key in ("obj_path", "obj_code", "object") if key in data)
    target = named_object(str(next(filter(None, named), path.parent.name)), scale, options, path)
    T_file = as_pose(data.numbers("obj_pose").ravel()[:7], f"{path}: obj_pose")
    T_world_object = pose_of_centre(T_file, target)

    def stage(row: Array) -> HandStage:
        """Return the stage of a row: a pose of 7 numbers, then the joints."""
        return HandStage(as_pose(row[:7], f"{path}: a hand pose") @ to_hand, row[7:])

    sources = [f"{path}[{number}]" for number in range(len(rows))] if len(rows) > 1 else [str(path)]
    return [
        FloatingGrasp(source, hand, target, T_world_object, stage(first), stage(middle), stage(last))
        for source, (first, middle, last) in zip(sources, rows, strict=True)
    ]


def _configurations(data: FileFields, hand: HandModel) -> tuple[Array, Array]:
    """Return rows (N, 3, 7 + n) of the three stages, and the hand's frame (4, 4) in that of their poses."""
    width = 7 + len(hand.joint_names)
    if "robot_pose" in data:
        rows = data.numbers("robot_pose")
        if rows.ndim < 3 or rows.shape[-1] != width or rows.shape[-2] < 3:
            raise InputError(
                f"{data.source}: robot_pose is {rows.shape}: valid is (..., N, at least 3, {width})"
            )
        return rows.reshape(-1, *rows.shape[-2:])[:, :3], np.eye(4)
    stages = []
    for name in ("pregrasp", "grasp", "squeeze"):
        row = data.numbers(f"{name}_qpos")
        if f"{name}_pose" in data:
            row = np.concatenate([data.numbers(f"{name}_pose"), row], axis=-1)
        if row.ndim not in (1, 2) or row.shape[-1] != width:
            raise InputError(
                f"{data.source}: {name}_qpos is {row.shape}: valid is ({width},) or (N, {width}) for {hand.name}"
            )
        stages.append(np.atleast_2d(row))
    if len({len(stage) for stage in stages}) > 1:
        raise InputError(f"{data.source}: pregrasp, grasp and squeeze are of different numbers of grasps")
    return np.stack(stages, axis=1), _ROOT_TO_PALM if hand.name == ALLEGRO else np.eye(4)


def read_dictionary(path: Path) -> Fields:
    """Return the dictionary of arrays, numbers and texts that an .npy (or .pkl) file holds.

    Raises:
        InputError: if the file is missing or damaged, holds something else, or asks for anything but arrays.
    """
    with readable(path):
        data = read_file(path)
    try:
        content = unpickle(_pickled(data))
    except pickle.UnpicklingError as error:
        raise InputError(
            f"{path} is not read ({str(error) or 'damaged'}): valid are dictionaries of arrays, numbers and text"
        ) from None
    except Exception as error:  # a damaged pickle fails in any way it likes, none of them ours to run into
        raise InputError(f"{path} is damaged or no pickled dictionary ({type(error).__name__})") from None
    if isinstance(content, np.ndarray) and content.shape == () and content.dtype == object:
        content = content.item()
    if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
        raise InputError(
            f"{path} holds no dictionary: valid are dictionaries of arrays as np.save writes them"
        )
    return content


def _pickled(data: bytes) -> bytes:
    """Return the pickle in an .npy file of an object; that of None for an array of plain numbers."""
    if not data.startswith(b"\x93NUMPY"):
        return data
    file, npy = io.BytesIO(data), np.lib.format
    major, _ = npy.read_magic(file)
    read = npy.read_array_header_1_0 if major == 1 else npy.read_array_header_2_0
    return file.read() if read(file)[2].hasobject else pickle.dumps(None)
