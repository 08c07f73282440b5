"""The user's cache: results that are costly to compute, keyed by the content they came from."""

import hashlib
import os
import tempfile
from pathlib import Path

import numpy as np
import platformdirs


def cache_dir() -> Path:
    """Return the cache folder (`DEXGRASP_CACHE` overrides it), made if it is not there."""
    path = Path(os.environ.get("DEXGRASP_CACHE") or platformdirs.user_cache_dir("dexgrasp"))
    path.mkdir(parents=True, exist_ok=True)
    return path


def content_hash(*parts: object) -> str:
    """Return a 16-digit hash of arrays and printable values."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype}{part.shape}".encode())
            digest.update(np.ascontiguousarray(part).tobytes())
        else:
            digest.update(repr(part).encode())
    return digest.hexdigest()[:16]


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that a killed process leaves the old one or the new one, never half of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
