"""MuJoCo's distance of two geoms for compiled code, which calls it by name: by address it could not be kept on disk."""

import ctypes
import sys
from typing import Any

from llvmlite import binding as llvm
from mujoco import _functions
from numba.core import types

from dexgrasp_env.compiled import config
from dexgrasp_env.errors import InputError

_NAME = "mj_geomDistance"


def _bound() -> Any:
    """Return MuJoCo's function, known to compiled code from now on.

    Raises:
        InputError: for a MuJoCo whose library does not have it.
    """
    # Elsewhere than on Windows the bindings' own file leads to the library that they are linked with.
    library = "mujoco.dll" if sys.platform == "win32" else _functions.__file__
    try:
        function = getattr(ctypes.CDLL(library), _NAME)
    except (AttributeError, OSError) as error:
        raise InputError(f"MuJoCo's library has no {_NAME}, install mujoco anew: {error}") from None
    llvm.add_symbol(_NAME, ctypes.cast(function, ctypes.c_void_p).value)
    function.restype, number = ctypes.c_double, ctypes.c_int32
    function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, number, number, ctypes.c_double, ctypes.c_void_p]
    if config.DISABLE_JIT:
        return function
    address, geom = types.intp, types.int32
    return types.ExternalFunction(_NAME, types.float64(address, address, geom, geom, types.float64, address))


geom_distance = _bound()
"""distance(model, data, geom, other, most, ends) by addresses, as in MuJoCo; it reads no more of the data than where
geoms are, and writes nothing but the ends. What it is asked is not checked: a wrong geom would end the process."""
