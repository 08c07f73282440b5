"""Dictionaries of arrays as `np.save` writes them: pickles, of which nothing is run."""

import io
import pickle
from pathlib import Path

import numpy as np

from dexgrasp.runs.pickles import unpickle
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_file, readable

_NPY = b"\x93NUMPY"


def read_dictionary(path: Path) -> Fields:
    """Return the dictionary of arrays, numbers and texts that an .npy (or .pkl) file holds.

    Raises:
        InputError: if the file is missing or damaged, holds something else, or asks for anything but arrays.
    """
    with readable(path):
        data = read_file(path)
    try:
        content = unpickle(_pickled(data))
    except pickle.UnpicklingError as error:
        raise InputError(
            f"{path} is not read ({str(error) or 'damaged'}): valid are dictionaries of arrays, numbers and text"
        ) from None
    except Exception as error:  # a damaged pickle fails in any way it likes, none of them ours to run into
        raise InputError(f"{path} is damaged or no pickled dictionary ({type(error).__name__})") from None
    if isinstance(content, np.ndarray) and content.shape == () and content.dtype == object:
        content = content.item()
    if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
        raise InputError(
            f"{path} holds no dictionary: valid are dictionaries of arrays as np.save writes them"
        )
    return content


def _pickled(data: bytes) -> bytes:
    """The pickle that an .npy file of an object holds; None's where it holds plain numbers."""
    if not data.startswith(_NPY):
        return data
    file = io.BytesIO(data)
    major, _ = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
    return file.read() if read(file)[2].hasobject else pickle.dumps(None)
