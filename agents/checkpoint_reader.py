"""Reader of Stable-Baselines3 checkpoints, without running anything that its author put in.

Its zip has tensors, which torch reads as such (`weights_only`), and settings as JSON, some of them pickled. Stable-
Baselines3 would unpickle these whatever they are; here only spaces, policies and schedules of known libraries and of
this project are made, and what else there is, such as the optimiser's schedule, is replaced: acting needs none of it.
"""

import base64
import binascii
import json
import pickle
import re
import zipfile
from pathlib import Path
from typing import Any

from dexgrasp.runs.pickles import unpickle
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError, first_line
from dexgrasp_env.files import check_archive, check_bytes, read_file

_ENTRY = re.compile(r"data|[\w.]+\.pth|_stable_baselines3_version|system_info\.txt")
_NEEDED = ("policy_class", "observation_space", "action_space", "policy_kwargs")
_REPLACED = {"learning_rate": 0.0, "clip_range": 0.2, "lr_schedule": 0.0, "train_freq": 1}
_CLASSES = re.compile(
    r"(stable_baselines3|sb3_contrib)\.((common|\w+)\.policies|common\.((recurrent|sb2_compat)\.)?"
    r"(buffers|policies|utils|type_aliases|torch_layers|noise|rmsprop_tf_like))"
    r"|stable_baselines3\.common\.(running_mean_std|vec_env\.vec_normalize)"
    r"|gymnasium\.spaces\.\w+|torch\.nn\.modules\.activation|torch\.optim\.(adam\w*|[nr]adam|rmsprop|sgd)"
    r"|(dexgrasp|dexgrasp_env)\.[\w.]+"
)
"""Modules of which classes may be made."""
_NAMES = {
    ("collections", "OrderedDict"), ("collections", "deque"), ("builtins", "set"), ("builtins", "slice"),
    ("numpy.random._pickle", "__generator_ctor"),
    ("numpy.random._pickle", "__bit_generator_ctor"), ("numpy.random._pcg64", "PCG64"),
    ("numpy.random.bit_generator", "__pyx_unpickle_SeedSequence"), ("numpy.random.bit_generator", "SeedSequence"),
}  # fmt: skip


def read_settings(path: Path) -> Fields:
    """Return the settings of a checkpoint as JSON holds them, pickled ones still as text.

    Raises:
        InputError: if it is no checkpoint of Stable-Baselines3.
    """
    try:
        check_archive(path)
        with zipfile.ZipFile(path) as archive:
            _check_layout(archive)
            check_bytes(archive.getinfo("data").file_size, f"data in {path}", ".json")
            return dict(json.loads(archive.read("data")))
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except Exception as error:  # a zip can be damaged in many ways
        raise InputError(
            f"{path} is not a checkpoint of Stable-Baselines3: {first_line(error)[:100]}"
        ) from None


def _check_layout(archive: zipfile.ZipFile) -> None:
    names = archive.namelist()
    for needed in ("data", "policy.pth"):
        if names.count(needed) != 1:
            raise ValueError(f"no zip with one entry {needed!r}")
    for name in names:
        if not _ENTRY.fullmatch(name):
            raise ValueError(f"entry {name[:60]!r} is none of theirs")


def harmless_objects(path: Path, settings: Fields) -> Fields:
    """Return what stands for each pickled setting: Stable-Baselines3 then unpickles nothing.

    Raises:
        InputError: naming what a policy cannot do without and this reader does not make.
    """
    found: Fields = {"buffer_size": 1}  # of memory for learning
    for key, value in settings.items():
        if not isinstance(value, dict) or ":serialized:" not in value:
            continue
        try:
            found[key] = _unpickled(value[":serialized:"])
        except Exception as error:
            if key in _NEEDED:
                raise InputError(
                    f"{path}: {key} is not read, as {first_line(error)[:120]} (an agent of your own is "
                    "named package.module:Class)"
                ) from None
            found[key] = _REPLACED.get(key)
    return found


def statistics_files(path: Path) -> list[Path]:
    """Return where `VecNormalize` may have saved what it counted, for a checkpoint."""
    return [path.with_suffix(".pkl"), path.with_name("vecnormalize.pkl")]


def counted(path: Path) -> Any:
    """Return the `VecNormalize` that was saved beside a checkpoint, None where there is none.

    Raises:
        InputError: if it is none, or asks for what is not read.
    """
    for file in statistics_files(path):
        if file.is_file():
            content = read_file(file)
            try:
                return unpickle(content, _NAMES, _CLASSES)
            except Exception as error:  # damaged ones fail in many ways
                raise InputError(f"{file} holds no VecNormalize: {first_line(error)[:120]}") from None
    return None


def _unpickled(text: Any) -> Any:
    try:
        return unpickle(base64.b64decode(text), _NAMES, _CLASSES)
    except (binascii.Error, TypeError, EOFError) as error:
        raise pickle.UnpicklingError(f"it is damaged ({error})") from None
