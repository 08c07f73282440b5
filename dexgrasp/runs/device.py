"""Where torch computes."""

from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch

DEVICES = ("auto", "cpu", "cuda")


def torch_device(name: str) -> torch.device:
    """Return the device of a name: auto, cpu or cuda.

    Raises:
        InputError: for another name, or a device that is not there.
    """
    if name not in DEVICES:
        raise InputError(f"device {name!r}: valid are {', '.join(DEVICES)}")
    if name == "cuda" and not torch.cuda.is_available():
        raise InputError("device 'cuda': there is none that torch can use; valid are auto, cpu")
    return torch.device("cuda" if name != "cpu" and torch.cuda.is_available() else "cpu")
