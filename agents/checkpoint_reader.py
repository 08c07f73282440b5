"""Reader of Stable-Baselines3 checkpoints, without running anything that its author put in.

Its zip has tensors, which torch reads as such (`weights_only`), and settings as JSON, some of them pickled. Stable-
Baselines3 would unpickle these whatever they are; here those that acting needs are: the policy's class, arguments and
spaces, of known libraries and of this project. Its algorithm is not made.
"""

import base64
import io
import json
import re
import zipfile
from inspect import signature
from pathlib import Path
from typing import Any

from dexgrasp.runs.pickles import unpickle
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import understood
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import check_archive, check_bytes, read_file, readable

with from_extra():
    import torch

_CLASSES = re.compile(
    r"(stable_baselines3|sb3_contrib)\.((common|\w+)\.policies|common\.((recurrent|sb2_compat)\.)?"
    r"(policies|torch_layers|rmsprop_tf_like))"
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
    with understood(path, "a checkpoint of Stable-Baselines3"), readable(path):
        check_archive(path)
        with zipfile.ZipFile(path) as archive:
            check_bytes(archive.getinfo("data").file_size, f"data in {path}", ".json")
            return dict(json.loads(archive.read("data")))


def open_policy(path: Path) -> Any:
    """Return the policy of a checkpoint, made of its class, spaces and arguments, and of its weights.

    Raises:
        InputError: naming what this reader does not make, or does not fit.
    """
    settings = read_settings(path)
    with understood(path, "a policy here: valid is an agent of your own too, named package.module:Class"):
        kind, seen, acts, more = (
            _unpickled(settings[key])
            for key in ("policy_class", "observation_space", "action_space", "policy_kwargs")
        )
        usual = {"lr_schedule": lambda _: 0.0, "use_sde": settings.get("use_sde", False)}
        usual = {key: value for key, value in usual.items() if key in signature(kind).parameters}
        policy = kind(seen, acts, **usual | more)
        with zipfile.ZipFile(path) as archive:
            weights = torch.load(io.BytesIO(archive.read("policy.pth")), "cpu", weights_only=True)
        policy.load_state_dict(weights)
    return policy


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
            with understood(file, "a VecNormalize"):
                found = unpickle(read_file(file), _NAMES, _CLASSES)
                return found if "obs_rms" in vars(found) else None
    return None


def _unpickled(value: Any) -> Any:
    """Return a setting: those that JSON does not hold are pickled, in base64."""
    if not isinstance(value, dict) or ":serialized:" not in value:
        return value
    return unpickle(base64.b64decode(value[":serialized:"]), _NAMES, _CLASSES)
