"""Arrays on warp's device: rows for single worlds sent in one copy, and numbers of 32 bits as numpy has them."""

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra

with from_extra():
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR  # that there is no GPU is said by `find_device`, to who asks for one


@wp.kernel(enable_backward=False)
def _scatter(
    rows: wp.array2d[wp.int32], worlds: wp.array[wp.int32], first: int, out: wp.array2d[wp.int32]
) -> None:
    """Write columns of rows, from `first` on, to the rows of the worlds."""
    row, k = wp.tid()
    out[worlds[row], k] = rows[row, first + k]


class ScatterQueue:
    """Rows of numbers for single worlds, collected and then sent: one copy, and a launch for each array."""

    def __init__(self, targets: list[Any]) -> None:
        """Make none.

        Args:
            targets: arrays (N, width) of whole numbers, as of `columns`; a row has numbers for one after the other.
        """
        self._targets, self._device = targets, targets[0].device
        self._pending: dict[int, NDArray[np.int32]] = {}

    def put(self, i: int, *values: NDArray[Any]) -> None:
        """Note what world `i` is to be told, in place of what was noted before."""
        self._pending[i] = np.concatenate([bits(value) for value in values])

    def send(self) -> None:
        """Send what is noted."""
        if self._pending:
            worlds = wp.array(np.array(list(self._pending), np.int32), dtype=wp.int32, device=self._device)
            rows = wp.array(np.stack(list(self._pending.values())), dtype=wp.int32, device=self._device)
            first = 0
            for array in self._targets:
                shape = len(worlds), array.shape[1]
                wp.launch(_scatter, shape, [rows, worlds, first], [array], device=self._device)
                first += array.shape[1]
            self._pending.clear()


def columns(array: Any, first: int = 0, width: int | None = None, dtype: Any = wp.int32) -> Any:
    """Return columns of an array of the device as rows (N, width) of numbers of 32 bits; memory is shared."""
    stride = array.strides[0]
    shape = (array.shape[0], stride // 4 - first if width is None else width)
    return wp.array(
        ptr=array.ptr + 4 * first, shape=shape, strides=(stride, 4), dtype=dtype, device=array.device
    )


def bits(values: NDArray[Any]) -> NDArray[np.int32]:
    """Return numbers as 32 bits each, in a row."""
    return np.ascontiguousarray(values, dtype=numbers_of(values.dtype)).view(np.int32).ravel()


def numbers_of(kind: np.dtype[Any]) -> type[np.float32] | type[np.int32]:
    """Return what numbers of a kind are there."""
    return np.float32 if kind.base.kind == "f" else np.int32


def as_struct(name: str, values: Fields) -> Any:
    """Return what compiled functions are told, by name, as a struct of the device in scope.

    Args:
        name: of the struct.
        values: numbers, and arrays of numpy or of warp.
    """
    values = values | {
        key: wp.array(value, dtype=wp.dtype_from_numpy(numbers_of(value.dtype)))
        for key, value in values.items()
        if isinstance(value, np.ndarray)
    }
    struct = _struct(name, tuple((key, _kind(value)) for key, value in values.items()))()
    for key, value in values.items():
        setattr(struct, key, value)
    return struct


def _kind(value: Any) -> tuple[Any, int]:
    return (value.dtype, value.ndim) if isinstance(value, wp.array) else (type(value), 0)


@functools.cache
def _struct(name: str, kinds: tuple[tuple[str, tuple[Any, int]], ...]) -> Any:
    hints = {key: wp.array(dtype=dtype, ndim=ndim) if ndim else dtype for key, (dtype, ndim) in kinds}
    return wp.struct(type(name, (), {"__annotations__": hints, "__module__": __name__}))


def find_device(device: str | None) -> Any:
    """Return a device as warp names it; None: a GPU where there is one.

    Raises:
        InputError: if there is none of that name.
    """
    try:
        return wp.get_preferred_device() if device is None else wp.get_device(device)
    except (ValueError, RuntimeError):
        valid = ", ".join(found.alias for found in wp.get_devices())
        raise InputError(f"device {device!r} is not here: valid are {valid}") from None
