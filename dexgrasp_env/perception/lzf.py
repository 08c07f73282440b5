"""Unpacking of LZF, the compression of PCD files: runs of bytes, and copies of what came up to 8 kB before."""

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.compiled import njit

Bytes = NDArray[np.uint8]


def unpack(packed: Bytes, size: int) -> Bytes | None:
    """Return `size` bytes that were packed, or None where these are not what is packed."""
    out = np.empty(size, np.uint8)
    return out if _unpacked(packed, out) == size else None


@njit
def _unpacked(packed: Bytes, out: Bytes) -> int:
    """Write what was packed to `out`; return its length, -1 where it is damaged or does not fit."""
    read, written = 0, 0
    while read < packed.shape[0]:
        code = int(packed[read])
        read += 1
        if code < 32:  # a run of code + 1 bytes
            length = code + 1
            if read + length > packed.shape[0] or written + length > out.shape[0]:
                return -1
            for k in range(length):
                out[written + k] = packed[read + k]
            read += length
        else:  # a copy: its length in three bits or a byte more, how far back in 13 bits
            length = code >> 5
            last = 1 if length == 7 else 0
            if read + last >= packed.shape[0]:
                return -1
            if last:
                length += int(packed[read])
            length += 2
            start = written - ((code & 31) << 8) - int(packed[read + last]) - 1
            read += last + 1
            if start < 0 or written + length > out.shape[0]:
                return -1
            for k in range(length):
                out[written + k] = out[start + k]
        written += length
    return written
