"""Readers of grasp files: ours, DexGraspBench's and BODex's, FRoGGeR-style arrays, and a plain JSON."""

from pathlib import Path

from dexgrasp.evaluation.scoring.hand import FloatingGrasp
from dexgrasp.evaluation.scoring.readers.dexgraspbench import read_dexgraspbench
from dexgrasp.evaluation.scoring.readers.frogger import read_frogger
from dexgrasp.evaluation.scoring.readers.json_files import FORMAT, read_ours, read_plain
from dexgrasp.evaluation.scoring.readers.objects import ReadOptions
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_json_object

__all__ = ["ReadOptions", "read_candidates"]

_BY_SUFFIX = {".npy": read_dexgraspbench, ".pkl": read_dexgraspbench, ".npz": read_frogger}


def read_candidates(path: Path, options: ReadOptions) -> list[FloatingGrasp]:
    """Return the grasps of a file of any known format; nothing in it is executed.

    Raises:
        InputError: if the file is missing, of no known format or malformed, or its object is not found.
    """
    if path.suffix in _BY_SUFFIX:
        return _BY_SUFFIX[path.suffix](path, options)
    if path.suffix != ".json":
        raise InputError(
            f"grasp file {str(path)!r} has the wrong kind {path.suffix!r}: valid are .json, .npz, .npy and .pkl"
        )
    content = read_json_object(path, "it is no grasp file")
    return (read_plain if content.get("format") == FORMAT else read_ours)(content, path, options)
