"""Files of DexGraspBench and BODex: `.npy` dictionaries of configurations, object pose and scale.

Three layouts: `pregrasp_qpos`, `grasp_qpos`, `squeeze_qpos` (7 + n: base position m, quaternion wxyz, joints), one or
many along a first axis; the same with the base apart as `*_pose`; and BODex's own `robot_pose` (..., N, stages, 7 + n).
Joints are in the order of the hand's file; for the Allegro: index, middle, ring, thumb, palm to tip, as in ours.
`obj_pose` is of the mesh file's frame, z up, the table at z = 0; `obj_path` an object folder. An `approach_qpos` is not
used.
"""

from pathlib import Path

import numpy as np

from dexgrasp.scoring.candidate import Candidate, HandStage
from dexgrasp.scoring.hand import ALLEGRO, HandModel, find_hand
from dexgrasp.scoring.readers.dictionary import read_dictionary
from dexgrasp.scoring.readers.fields import FileFields, as_pose
from dexgrasp.scoring.readers.objects import ReadOptions, find_object, pose_of_centre
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import pose_matrix

STAGES = ("pregrasp", "grasp", "squeeze")
_ROOT_TO_PALM = pose_matrix(np.zeros(3), np.array([0.0, 0.5**0.5, 0.0, 0.5**0.5]))
"""The palm in the root frame of its Allegro file; the poses in BODex's own layout are the palm's."""


def read_dexgraspbench(path: Path, options: ReadOptions) -> list[Candidate]:
    """Return the grasps of a file.

    Raises:
        InputError: if the file is unusable, asks for code, misses a key, or its object is not found.
    """
    data, hand = FileFields(read_dictionary(path), str(path)), find_hand(options.hand)
    rows, to_hand = _configurations(data, hand)
    scale = data.numbers("obj_scale").item(0) if "obj_scale" in data else 1.0
    named = [
        str(data.get(key)) for key in ("obj_path", "obj_code", "object") if key in data and data.get(key)
    ]
    target = find_object([*named, path.parent.name][0], scale, options, path)
    T_file = as_pose(data.numbers("obj_pose").ravel()[:7], f"{path}: obj_pose")
    T_world_object = pose_of_centre(T_file, target)

    def stage(row: Array) -> HandStage:
        return HandStage(as_pose(row[:7], f"{path}: a hand pose") @ to_hand, row[7:])

    sources = [f"{path}[{number}]" for number in range(len(rows))] if len(rows) > 1 else [str(path)]
    return [
        Candidate(source, hand, target, T_world_object, stage(first), stage(middle), stage(last))
        for source, (first, middle, last) in zip(sources, rows, strict=True)
    ]


def _configurations(data: FileFields, hand: HandModel) -> tuple[Array, Array]:
    """Return (N, 3, 7 + n) of the three stages, and the hand's frame in that of their poses."""
    width = 7 + len(hand.joint_names)
    if "robot_pose" in data:
        rows = data.numbers("robot_pose")
        if rows.ndim < 3 or rows.shape[-1] != width or rows.shape[-2] < 3:
            raise InputError(
                f"{data.source}: robot_pose is {rows.shape}: valid is (..., N, at least 3, {width})"
            )
        return rows.reshape(-1, *rows.shape[-2:])[:, :3], np.eye(4)
    stages = []
    for name in STAGES:
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
