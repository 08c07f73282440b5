"""Readers of grasp files: ours, DexGraspBench's and BODex's, FRoGGeR-style arrays, and a plain JSON."""

import json
from pathlib import Path

from dexgrasp.scoring.candidate import Candidate
from dexgrasp.scoring.readers.dexgraspbench import read_dexgraspbench
from dexgrasp.scoring.readers.frogger import read_frogger
from dexgrasp.scoring.readers.objects import ReadOptions
from dexgrasp.scoring.readers.ours import read_ours
from dexgrasp.scoring.readers.plain import is_plain, read_plain
from dexgrasp_env.errors import InputError

__all__ = ["ReadOptions", "read_candidates"]

_BY_SUFFIX = {".npy": read_dexgraspbench, ".pkl": read_dexgraspbench, ".npz": read_frogger}


def read_candidates(path: Path, options: ReadOptions) -> list[Candidate]:
    """Return the grasps of a file, of whatever kind it is; nothing in it is executed.

    Raises:
        InputError: one line, if the file is missing, of no known kind or malformed, or its object is not found.
    """
    if path.suffix in _BY_SUFFIX:
        return _BY_SUFFIX[path.suffix](path, options)
    if path.suffix != ".json":
        raise InputError(
            f"grasp file {str(path)!r} has the wrong kind {path.suffix!r}: valid are .json, .npy, .npz"
        )
    try:
        content = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except ValueError:
        raise InputError(f"{path} holds no JSON (was it cut off?)") from None
    return read_plain(path, options) if is_plain(content) else read_ours(path, options)
